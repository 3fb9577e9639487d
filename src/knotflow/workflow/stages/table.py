"""Stage `table`: a table of an earlier stage, with the columns every committed one begins with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.provenance import Provenance


@dataclass
class TableConfig:
    """Which table."""

    file: str = ""
    """Its name in the output of the earlier stage."""
    provenance: Provenance = field(default_factory=Provenance)
    """The experiment-wide columns."""


@stage("table", version=1, inputs=("source",))
def stamp(config: TableConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes a file of the same name."""
    table = pd.read_csv(inputs["source"] / config.file)
    with context.atomic(config.file) as path:
        config.provenance.first(table).to_csv(path, index=False)
