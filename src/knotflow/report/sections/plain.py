"""An experiment without figures of its own: its tables as they are."""

from __future__ import annotations

from typing import Any

from knotflow.report.results import Results
from knotflow.report.rows import EXPERIMENT_COLUMNS
from knotflow.report.sections.section import Pictures, Section
from knotflow.report.tables import markdown_table

#: Longer tables are cut here; the file itself is one link away.
ROWS_SHOWN = 20


def plain(experiment: str, title: str, paper: str, about: str) -> Section:
    """A section that shows every table of an experiment, for those nobody wrote one for yet."""

    def values(results: Results, _: Pictures) -> dict[str, Any] | None:
        found = results.experiments.get(experiment)
        if found is None or not found.measured:
            return None
        tables = []
        for name, rows in found.tables.items():
            columns = [c for c in rows[0].cells if c not in EXPERIMENT_COLUMNS]
            shown = [[row.cells[c] for c in columns] for row in rows[:ROWS_SHOWN]]
            tables.append(
                {"name": name, "rows": len(rows), "table": markdown_table(columns, shown)}
            )
        return {"tables": tables, "shown": ROWS_SHOWN}

    return Section(experiment, title, paper, about, values, template="plain")
