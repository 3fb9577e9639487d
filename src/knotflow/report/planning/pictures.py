"""Pictures that an experiment drew itself, kept beside its tables as PNG and SVG."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from knotflow.report.results import Results
from knotflow.report.style import Picture


def stored(
    results: Results,
    add: Callable[[Picture], str],
    experiment: str,
    stem: str,
    name: str,
    alt: str,
) -> str:
    """The Markdown that shows results/<experiment>/<stem>.png, '' where there is none.

    Args:
        results: where it is.
        add: takes it into the report and gives the Markdown, `Pictures.add`.
        experiment: that made it.
        stem: path in the experiment's folder, without the endings png and svg.
        name: what the figure is called in the report.
        alt: what it shows in words.
    """
    found = results.experiments.get(experiment)
    if found is None:
        return ""
    png, svg = (Path(f"{found.folder / stem}.{ending}") for ending in ("png", "svg"))
    if not (png.is_file() and svg.is_file()):
        return ""
    # matplotlib ends lines of path data with blanks, which a repository does not like.
    clean = re.sub(rb"[ \t]+$", b"", svg.read_bytes(), flags=re.MULTILINE)
    return add(Picture(name, png.read_bytes(), clean, alt))
