"""The old names of `knotflow.training.trainer.SupervisedTrainer`."""

from __future__ import annotations

from knotflow.training.trainer import SupervisedTrainer


class SupervisedTraining(SupervisedTrainer):
    """`SupervisedTrainer` by the old names of its methods."""

    def update(self, step: int) -> float:
        return self._step(step)

    def _step(self, step: int) -> float:
        raise NotImplementedError

    _done = SupervisedTrainer.fraction
    _descend = SupervisedTrainer.descend
