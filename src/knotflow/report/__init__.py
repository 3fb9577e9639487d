"""The report: the committed tables of results/ as figures, tables and verdicts beside the paper's.

Reads plain files only and imports no package that simulates, so it works from a clone alone.
"""

from __future__ import annotations

from knotflow.report.page import make
from knotflow.report.results import ResultsError

__all__ = ["ResultsError", "make"]
