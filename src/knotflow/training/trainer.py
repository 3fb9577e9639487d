"""What all trainings share: rounds, checkpoints, curves, and the driver that resumes them."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd
import torch
from torch import Tensor, nn
from tqdm import tqdm

CHECKPOINT = "checkpoint.pt"
CURVES = "curves.csv"

Metrics = dict[str, float]


class Trainer(ABC):
    """A training in rounds; iterating over it trains, and yields the metrics of each round."""

    def __init__(self, rounds: int) -> None:
        self.rounds = rounds
        self.history: list[Metrics] = []
        """Metrics of the rounds that are done."""

    def __iter__(self) -> Iterator[Metrics]:
        while len(self.history) < self.rounds:
            number = len(self.history)
            self.history.append({"step": number} | self.step() | self.validate())
            yield self.history[-1]

    @abstractmethod
    def step(self) -> Metrics:
        """One round; metrics of it. A metric "step" replaces the round's number in the curves."""

    def validate(self) -> Metrics:
        """Metrics on what is held out."""
        return {}

    @property
    def parts(self) -> dict[str, Any]:
        """All that changes in training: random generators, what has a `state_dict`, and dicts."""
        return {}

    def save(self, path: Path) -> None:
        torch.save({"history": self.history, **_state_of(self.parts)}, path)

    def load(self, path: Path) -> None:
        """Continue from what a training with the same arguments saved."""
        state = torch.load(path, weights_only=True)
        self.history = list(state["history"])
        _restore(self.parts, state)


def _state_of(part: Any) -> Any:
    match part:
        case dict():
            return {str(name): _state_of(one) for name, one in part.items()}
        case np.random.Generator():
            return part.bit_generator.state
        case torch.Generator():
            return part.get_state()
    return part.state_dict()


def _restore(part: Any, state: Any) -> None:
    match part:
        case dict():
            for name, one in part.items():
                _restore(one, state[str(name)])
        case np.random.Generator():
            part.bit_generator.state = state
        case torch.Generator():
            part.set_state(state)
        case _:
            part.load_state_dict(state)


class Effort(Protocol):
    """The configuration of a supervised training."""

    validations: int
    """Rounds."""
    steps: int
    """Gradient steps in a round."""
    learning_rate: float
    weight_decay: float
    gradient_norm: float


class SupervisedTrainer(Trainer):
    """A network fitted with AdamW; a round is `effort.steps` gradient steps and a validation."""

    measure = "loss"
    """Name of the metric that is the mean of what `update` returns."""

    def __init__(self, model: nn.Module, effort: Effort, seed: int) -> None:
        super().__init__(effort.validations)
        self.model, self.effort = model, effort
        self.generator = torch.Generator().manual_seed(seed)
        """Everything random comes from it."""
        self.optimizer = torch.optim.AdamW(
            model.parameters(), effort.learning_rate, weight_decay=effort.weight_decay
        )

    def step(self) -> Metrics:
        self.model.train()
        first = len(self.history) * self.effort.steps
        measured = [self.update(first + step) for step in range(self.effort.steps)]
        return {"step": first + self.effort.steps, self.measure: float(np.mean(measured))}

    @abstractmethod
    def update(self, step: int) -> float:
        """Take gradient step number `step`; what is measured of it."""

    def fraction(self, step: int) -> float:
        """Fraction of all gradient steps that lie before this one, 0..1."""
        return step / (self.rounds * self.effort.steps)

    def descend(self, loss: Tensor, learning_rate: float) -> None:
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate
        self.optimizer.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.effort.gradient_norm)
        self.optimizer.step()

    @property
    def parts(self) -> dict[str, Any]:
        return {"model": self.model, "optimizer": self.optimizer, "generator": self.generator}


def run_training(
    trainer: Trainer,
    out: Path,
    *,
    name: str,
    progress: Callable[..., Any] = tqdm,
    save_every: int = 1,
    finish: Callable[[], None] | None = None,
) -> None:
    """Train to the end, from the checkpoint in `out` if there is one; makes out/curves.csv.

    A process that is killed at any time and started again ends with the same weights and curves.
    `name` is of the bar that `progress` makes, as tqdm does; `save_every` are the rounds between
    two checkpoints. `finish` saves what was trained; afterwards the checkpoint is removed.
    """
    out.mkdir(parents=True, exist_ok=True)
    checkpoint = out / CHECKPOINT
    if checkpoint.exists():
        trainer.load(checkpoint)
    with progress(total=trainer.rounds, initial=len(trainer.history), desc=name) as bar:
        for _ in trainer:
            if len(trainer.history) % save_every == 0:
                _replace(checkpoint, trainer.save)
            bar.update()
    curves = pd.DataFrame(trainer.history)
    _replace(out / CURVES, lambda path: curves.to_csv(path, index=False, float_format="%.6g"))
    if finish is not None:
        finish()
    checkpoint.unlink(missing_ok=True)


def _replace(path: Path, write: Callable[[Path], Any]) -> None:
    """Write a file under a temporary name, then rename it: it is whole or not there."""
    temporary = path.with_name(f".tmp-{path.name}")
    write(temporary)
    os.replace(temporary, path)


def merge_curves(parts: Mapping[int, Path]) -> pd.DataFrame:
    """Curves (files by primitive) as one table with a row a value: primitive, step, metric, value.

    A column `3/loss` is primitive 3's whatever file it stands in.
    """
    tables = []
    for primitive, path in parts.items():
        table = pd.read_csv(path).melt("step", var_name="metric", value_name="value").dropna()
        named = table["metric"].str.extract(r"^(?:(\d+)/)?(.*)$")
        table["metric"] = named[1]
        table.insert(0, "primitive", named[0].fillna(str(primitive)).astype(int))
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
