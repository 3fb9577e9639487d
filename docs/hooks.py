"""Adds the generated report and its figures to the site."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PICTURE = re.compile(r"(!\[[^\]]*\])\(\.\./results/([^)]+\.png)\)")
RESULT = re.compile(r"(?<!!)\[([^\]]*)\]\(\.\./results[^)]*\)")


def on_files(files: Files, config: Any) -> Files:
    """reports/report.md is the page report.md; pictures stand below figures/ and results/."""
    text = (ROOT / "reports" / "report.md").read_text("utf-8")
    text = PICTURE.sub(r"\1(results/\2)", text)
    text = RESULT.sub(r"\1", text)  # folders of the repository are no pages
    text = text.replace("](../docs/", "](")
    files.append(File.generated(config, "report.md", content=text))
    for picture in sorted((ROOT / "reports" / "figures").glob("*.png")):
        _add(files, config, f"figures/{picture.name}", picture)
    for name in sorted(set(re.findall(r"\((results/[^)]+\.png)\)", text))):
        _add(files, config, name, ROOT / name)
    if files.get_file_from_path("results/overhand/plan.png") is None:
        _add(files, config, "results/overhand/plan.png", ROOT / "results/overhand/plan.png")
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links of docs/ to the report and to results/ lead to the site's copies."""
    return markdown.replace("](../reports/report.md", "](report.md").replace(
        "](../results/", "](results/"
    )


def _add(files: Files, config: Any, name: str, source: Path) -> None:
    files.append(File.generated(config, name, abs_src_path=str(source)))
