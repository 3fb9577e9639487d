"""Training curves and checkpoints of one part of a stage: an interruption costs little."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pandas as pd

from knotflow.workflow.context import StageContext


class Curves:
    """The metrics of each step, and the checkpoint that belongs to the last saved one.

    A part trains one primitive, or several side by side.

    A checkpoint is a folder `checkpoints/<part>-<step>` that also holds the curve so far; making
    one removes the older. When the part is finished, `<part>.csv` has the whole curve.
    """

    def __init__(self, context: StageContext, part: str) -> None:
        """Goes on from the newest checkpoint of the part, if there is one."""
        self._context, self._part = context, part
        self._rows: list[dict[str, float]] = []
        if folder := self.checkpoint():
            self._rows = pd.read_csv(folder.parent / "curve.csv").to_dict("records")

    def __len__(self) -> int:
        return len(self._rows)

    def checkpoint(self) -> Path | None:
        """The newest checkpoint's folder for the training, or None."""
        found = sorted((self._context.out / "checkpoints").glob(f"{self._part}-*[0-9]"))
        return found[-1] / "training" if found else None

    def add(self, primitive: int, metrics: Mapping[str, float]) -> None:
        """Take the metrics of a primitive's next step, and log them."""
        step = sum(row["primitive"] == primitive for row in self._rows)
        self._rows.append({"primitive": primitive, "step": step, **metrics})
        for name, value in metrics.items():
            self._context.logger.log_scalar(f"primitive_{primitive}/{name}", value, step + 1)

    @contextmanager
    def saving(self) -> Iterator[Path]:
        """A folder to save the training to; it becomes the newest checkpoint when all is there."""
        older = list((self._context.out / "checkpoints").glob(f"{self._part}-*[0-9]"))
        name = f"checkpoints/{self._part}-{len(self._rows):05d}"
        with self._context.atomic(name) as folder:
            folder.mkdir(parents=True, exist_ok=True)
            yield folder / "training"
            pd.DataFrame(self._rows).to_csv(folder / "curve.csv", index=False)
        for path in older:
            shutil.rmtree(path, ignore_errors=True)

    def save(self) -> None:
        """Write the whole curve; the part is finished but for its product."""
        with self._context.atomic(f"{self._part}.csv") as path:
            pd.DataFrame(self._rows).to_csv(path, index=False)

    @staticmethod
    def merge(context: StageContext, parts: list[str]) -> None:
        """Bring the curves of all parts into curves.csv, one row a value, and drop checkpoints."""
        tables = [
            pd.read_csv(context.out / f"{part}.csv").melt(
                ["primitive", "step"], var_name="metric", value_name="value"
            )
            for part in parts
        ]
        with context.atomic("curves.csv") as path:
            pd.concat(tables).dropna().to_csv(path, index=False, float_format="%.6g")
        shutil.rmtree(context.out / "checkpoints", ignore_errors=True)
