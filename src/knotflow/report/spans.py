"""Numbers in Markdown that are read from the tables of results/.

Such a number stands between two marks, which Markdown does not show:

    <!-- share arm/trajectories.csv tied_as_exported where arm == 'panda' -->14 of 20<!-- / -->

Columns and rows are as `pandas` evaluates them; a column `hits/trials` counts many trials a row.
Without a table, or rows that fit, it is "not run".
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Verdict

SPAN = re.compile(r"(<!-- (\w+) (\S+)(?: (\S+))?(?: where (.+?))? -->)(.*?)(<!-- / -->)")


def _number(value: float) -> str:
    """One decimal unless it is 0: `4.2`, `1,428`."""
    return f"{value:,.1f}".removesuffix(".0")


MEASURES: dict[str, Callable[[pd.Series, pd.Series], str]] = {
    "share": lambda hits, trials: f"{hits.sum():,.0f} of {trials.sum():,.0f}",
    "percent": lambda hits, trials: f"{md.whole(100 * hits.sum() / trials.sum())} %",
    "median": lambda values, _: _number(values.median()),
    "mean": lambda values, _: _number(values.mean()),
    "sd": lambda values, _: _number(values.std()),
    "most": lambda values, _: _number(values.max()),
}
"""Of a column of the rows that fit; `state EXPERIMENT` is current, stale or – instead."""


def fill(text: str, results: Results, *, marks: bool = True) -> str:
    """`text` with the numbers that the tables have today, without the marks unless they stay.

    Raises:
        ResultsError: a mark asks for what its table does not have.
    """

    def written(match: re.Match[str]) -> str:
        start, measure, path, column, rows, _, end = match.groups()
        try:
            value = (
                _state(results, path)
                if measure == "state"
                else measured(measure, path, column, rows)
            )
        except (LookupError, NameError, TypeError, ValueError, SyntaxError) as problem:
            raise ResultsError(f"{start}: {problem}") from None
        return f"{start}{value}{end}" if marks else value

    def measured(measure: str, path: str, column: str, rows: str | None) -> str:
        if not (results.root / path).is_file():
            return str(Verdict.NOT_RUN)
        table = pd.read_csv(results.root / path)
        table = table.query(rows, engine="python") if rows else table
        hits, _, trials = column.partition("/")
        values = table.eval(hits, engine="python")
        counted = table[trials] if trials else values.notna()
        return MEASURES[measure](values, counted) if len(table) else str(Verdict.NOT_RUN)

    return SPAN.sub(written, text)


def _state(results: Results, experiment: str) -> str:
    found = results.measured(experiment)
    if not found:
        return md.NOTHING
    return "stale" if found.stale else "current" if found.budget == "paper" else found.budget


def pages(results: Results) -> dict[Path, bytes]:
    """README.md and docs/*.md beside the results folder, filled."""
    root = results.root.parent
    found = [root / "README.md", *sorted((root / "docs").glob("*.md"))]
    texts = {page: page.read_text("utf-8") for page in found if page.is_file()}
    return {page: fill(text, results).encode() for page, text in texts.items() if SPAN.search(text)}
