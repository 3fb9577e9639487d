"""What a section is: its place in the paper, its claims, and a function to its words' values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from knotflow.report.claims import Claim
from knotflow.report.results import Results, read_table
from knotflow.report.style import Picture, without_blanks
from knotflow.report.tables import markdown_table

#: Longer tables are cut here in a plain section; the file itself is one link away.
ROWS_SHOWN = 20


@dataclass
class Pictures:
    """The figures of the report as the sections make them."""

    made: list[Picture] = field(default_factory=list)

    def add(self, picture: Picture) -> str:
        """Keep a figure and give the Markdown that shows it."""
        if any(other.name == picture.name for other in self.made):
            raise ValueError(f"two figures are called {picture.name!r}; names have to differ")
        self.made.append(picture)
        return self.shown[picture.name]

    def stored(self, results: Results, experiment: str, stem: str, alt: str) -> str:
        """Keep a picture that an experiment drew itself; '' where there is none.

        Args:
            results: where it is.
            experiment: that made it.
            stem: path in the experiment's folder, without the endings png and svg; the figure is
                called after the experiment and the first part of it.
            alt: what it shows in words.
        """
        name = f"{experiment}_{Path(stem).parts[0]}"
        png, svg = (Path(f"{results.root / experiment / stem}.{end}") for end in ("png", "svg"))
        if not (png.is_file() and svg.is_file()):
            return ""
        return self.add(Picture(name, png.read_bytes(), without_blanks(svg.read_bytes()), alt))

    @property
    def shown(self) -> dict[str, str]:
        """The Markdown that shows each figure so far, by name."""
        return {one.name: f"![{one.alt}](figures/{one.name}.png)" for one in self.made}


@dataclass(frozen=True)
class Section:
    """One experiment's part of the report.

    `values` returns what the template needs, or None where the experiment was not run yet. The
    heading, the command, the budget and what it took are the same for all and not its concern.
    """

    experiment: str
    title: str
    paper: str
    about: str
    values: Callable[[Results, Pictures], dict[str, Any] | None]
    claims: tuple[Claim, ...] = ()
    template: str = ""

    @property
    def words(self) -> str:
        """The template's file name."""
        return f"{self.template or self.experiment}.md.j2"

    @property
    def command(self) -> str:
        """What makes it again."""
        return f"python -m knotflow +experiment={self.experiment}"


def plain(experiment: str, title: str, paper: str, about: str) -> Section:
    """A section that shows every table of an experiment, for those nobody wrote one for yet."""

    def values(results: Results, _: Pictures) -> dict[str, Any] | None:
        found = results.experiments.get(experiment)
        if found is None or not found.measured:
            return None
        tables = []
        for path in found.tables:
            table = read_table(path)
            shown = markdown_table(table.columns, table.head(ROWS_SHOWN).to_numpy().tolist())
            tables.append({"name": path.name, "rows": len(table), "table": shown})
        return {"tables": tables, "shown": ROWS_SHOWN}

    return Section(experiment, title, paper, about, values, template="plain")
