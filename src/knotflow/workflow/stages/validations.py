"""A training that goes by validations: its progress, checkpoint, curves and weights."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Protocol

import pandas as pd

from knotflow.workflow.context import StageContext

CHECKPOINT = "checkpoint.pt"


class ValidatedTraining(Protocol):
    """Iterating over it trains, and gives the metrics of one validation after the other."""

    history: list[dict[str, float]]

    def __iter__(self) -> Iterator[Mapping[str, float]]: ...

    def save(self, path: Path) -> None:
        """Write all that is needed to go on to a file."""
        ...

    def load(self, path: Path) -> None:
        """Go on from a file that `save` wrote."""
        ...


def run_validations(
    training: ValidatedTraining,
    context: StageContext,
    validations: int,
    steps: int,
    what: str,
    weights: tuple[str, Callable[[Path], None]],
) -> None:
    """Train to the end, resumed by validation; makes curves.csv and the weights.

    Args:
        training: what is trained.
        context: of the stage.
        validations: how many there will be, for the progress bar.
        steps: gradient steps between two of them.
        what: is trained, for the progress bar.
        weights: the file's name, and what writes it.
    """
    checkpoint = context.out / CHECKPOINT
    if checkpoint.exists():
        training.load(checkpoint)
    with context.progress(total=validations, initial=len(training.history), desc=what) as bar:
        for metrics in training:
            for name, value in metrics.items():
                context.logger.log_scalar(name, value, len(training.history))
            with context.atomic(CHECKPOINT) as path:
                training.save(path)
            bar.update()
    with context.atomic("curves.csv") as path:
        curves = pd.DataFrame(training.history)
        curves.insert(0, "step", (curves.index + 1) * steps)
        curves.to_csv(path, index=False, float_format="%.6g")
    name, write = weights
    with context.atomic(name) as path:
        write(path)
    checkpoint.unlink(missing_ok=True)
