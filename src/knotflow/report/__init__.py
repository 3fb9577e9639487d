"""The report: the committed tables of results/ as figures, tables and verdicts beside the paper's.

Reads plain files only and imports no other room, so it works from a clone without a simulator.
"""

from __future__ import annotations

from knotflow.report.page import make
from knotflow.report.rows import ResultsError

__all__ = ["ResultsError", "make"]
