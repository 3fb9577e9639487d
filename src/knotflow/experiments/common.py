"""What stages share: samplers, training, recordings of what they simulate, points as rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.recording import RecordedRollout, recorded, write_recording
from knotflow.samplers import Sampler, SamplerConfig, build_sampler
from knotflow.simulation import Attempts, RopeConfig
from knotflow.training.trainer import Trainer, run_training
from knotflow.workflow import StageRun

SEED = "training_seed"
"""The axis of workflows, and column of tables, of repeated trainings."""


def sampler_of(config: SamplerConfig, **inputs: Path | None) -> Sampler:
    """The sampler that a configuration names, from those inputs that are there."""
    return build_sampler(config, {name: path for name, path in inputs.items() if path is not None})


def train(
    run: StageRun, trainer: Trainer, name: str, weights: str, save: Callable[[Path], None],
    *, folder: str = "", save_every: int = 1,
) -> None:  # fmt: skip
    """Train to the end, with checkpoint and curves in `folder`; then `save` makes `weights`."""

    def finish() -> None:
        with run.atomic(weights) as path:
            save(path)

    run_training(
        trainer, run.out / folder, name=name, progress=run.progress, save_every=save_every,
        finish=finish,
    )  # fmt: skip


class Recorder:
    """Collects attempts (it is an `Observer`) until they are saved as one recording.

    `source` proposed the splines; numbers of rollouts, from `first_number` on, differ in a stage.
    """

    def __init__(self, run: StageRun, source: str, rope: RopeConfig, first_number: int = 0) -> None:
        self._run, self._source, self._rope = run, source, rope
        self._number = first_number
        self._batches: list[tuple[Attempts, Mapping[str, str]]] = []
        self.extra: Mapping[str, str] = {}
        """Kept with each attempt that is seen from now on."""

    def __call__(self, attempts: Attempts) -> None:
        """Take a batch."""
        self._batches.append((attempts, self.extra))

    def __len__(self) -> int:
        return sum(len(attempts) for attempts, _ in self._batches)

    def save(self, name: str) -> None:
        """Write everything seen so far, if anything, to `name` in the stage's folder; forget it."""
        if self._batches:
            facts = {"source": self._source, "signature": self._run.key}
            with self._run.atomic(name) as path:
                write_recording(path, self._rollouts(), facts)
        self._batches = []

    def _rollouts(self) -> Iterator[RecordedRollout]:
        for attempts, extra in self._batches:
            yield from recorded(
                attempts, self._rope, self._source, self._run.key, self._number, extra
            )
            self._number += len(attempts)


def distinct(folders: Mapping[str, Path], columns: Sequence[str]) -> dict[Path, dict[str, str]]:
    """Each of several folders once, and its name, such as "imitation.10", in parts by column.

    What needs no training has one folder under the names of all seeds: its `SEED` is empty.
    """
    found: dict[Path, dict[str, str]] = {}
    for name, folder in folders.items():
        parts = dict(zip(columns, name.split("."), strict=True)) if columns else {}
        found[folder] = parts | {SEED: ""} if folder in found else parts
    return found


def read_by_training(folders: Mapping[str, Path], name: str) -> pd.DataFrame:
    """A table in each of several folders, named by method and training seed, see `distinct`."""
    parts = distinct(folders, ["method", SEED])
    return pd.concat(pd.read_csv(folder / name).assign(**head) for folder, head in parts.items())


def point_rows(points: NDArray[np.float64], **facts: object) -> pd.DataFrame:
    """A row for each of points (P, 3), with `facts` in every one."""
    x, y, z = np.asarray(points, float).T
    return pd.DataFrame({**facts, "point": np.arange(len(x)), "x": x, "y": y, "z": z})
