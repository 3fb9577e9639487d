"""The columns that every committed table begins with."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from knotflow.workflow.signature import runtime


@dataclass
class Provenance:
    """Where a table comes from; no part of any signature, for it does not change the numbers."""

    experiment: str = runtime("")
    """Name of the experiment."""
    budget: str = runtime("")
    """The budget it was run with: paper or smoke."""
    commit: str = runtime("")
    """Git commit of the code that made the table, "+" appended where the tree had changes."""

    def first(self, table: pd.DataFrame) -> pd.DataFrame:
        """The table with the experiment-wide columns in front."""
        columns = {name: getattr(self, name) for name in ("experiment", "budget", "commit")}
        return pd.concat([pd.DataFrame(columns, index=table.index), table], axis=1)
