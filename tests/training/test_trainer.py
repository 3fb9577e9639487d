"""Trainings are resumed to the same end; their curves say so."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd
import pytest
import torch
from torch import nn

from knotflow.training.trainer import (
    CHECKPOINT,
    CURVES,
    SupervisedTrainer,
    merge_curves,
    run_training,
)


@dataclass
class Effort:
    validations: int = 5
    steps: int = 2
    learning_rate: float = 0.1
    weight_decay: float = 0.0
    gradient_norm: float = 1.0


class LineTrainer(SupervisedTrainer):
    """Fits y = 2 x."""

    measure = "error"

    def __init__(self):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)
            model = nn.Linear(1, 1)
        super().__init__(model, Effort(), 0)

    def update(self, step):
        x = torch.randn(4, 1, generator=self.generator)
        loss = (self.model(x) - 2 * x).square().mean()
        self.descend(loss, self.effort.learning_rate * (1 - self.fraction(step)))
        return float(loss.detach())

    def validate(self):
        return {"weight": self.model.weight.item()}


@pytest.fixture
def whole(tmp_path):
    trainer = LineTrainer()
    run_training(trainer, tmp_path / "whole", name="whole")
    return trainer


def same_weights(one, other):
    return all(
        torch.equal(one.model.state_dict()[name], value)
        for name, value in other.model.state_dict().items()
    )


@pytest.mark.parametrize(("save_every", "rounds"), [(1, 1), (2, 1), (2, 3), (1, 5)])
def test_interrupted_training_ends_with_same_weights_and_curves(
    whole, tmp_path, interrupted_training, save_every, rounds
):
    out = tmp_path / "broken"
    with interrupted_training(rounds):
        run_training(LineTrainer(), out, name="broken", save_every=save_every)
    assert (out / CHECKPOINT).exists() == (rounds >= save_every)
    trainer = LineTrainer()
    run_training(trainer, out, name="broken", save_every=save_every)
    assert same_weights(trainer, whole)
    assert (out / CURVES).read_bytes() == (tmp_path / "whole" / CURVES).read_bytes()
    assert [path.name for path in out.iterdir()] == [CURVES]


def test_checkpoint_is_kept_until_the_weights_are_saved(whole, tmp_path):
    def fail():
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        run_training(LineTrainer(), tmp_path / "full", name="full", finish=fail)
    trainer = LineTrainer()
    trainer.load(tmp_path / "full" / CHECKPOINT)
    assert same_weights(trainer, whole) and trainer.history == whole.history
    assert list(trainer) == []


def test_a_failed_write_leaves_the_last_checkpoint(tmp_path, monkeypatch):
    trainer, saved = LineTrainer(), []
    write = trainer.save

    def save(path):
        path.write_bytes(b"half of it")
        if saved:
            raise OSError("disk full")
        saved.append(write(path))

    monkeypatch.setattr(trainer, "save", save)
    with pytest.raises(OSError, match="disk full"):
        run_training(trainer, tmp_path, name="full")
    again = LineTrainer()
    again.load(tmp_path / CHECKPOINT)
    assert len(again.history) == 1


def test_curves_have_gradient_steps_and_metrics(whole, tmp_path):
    curves = pd.read_csv(tmp_path / "whole" / CURVES)
    assert list(curves.columns) == ["step", "error", "weight"]
    assert curves["step"].tolist() == [2, 4, 6, 8, 10]
    assert curves["weight"].iloc[-1] == pytest.approx(whole.model.weight.item(), rel=1e-5)


def test_merged_curves_have_a_row_a_value(tmp_path):
    (tmp_path / "one.csv").write_text("step,loss\n0,0.5\n1,0.25\n")
    (tmp_path / "all.csv").write_text('step,2/loss,"4/success/R1(0,1,1)"\n0,1.0,\n1,,0.5\n')
    merged = merge_curves({1: tmp_path / "one.csv", 9: tmp_path / "all.csv"})
    assert list(merged.columns) == ["primitive", "step", "metric", "value"]
    assert merged.to_numpy().tolist() == [
        [1, 0, "loss", 0.5],
        [1, 1, "loss", 0.25],
        [2, 0, "loss", 1.0],
        [4, 1, "success/R1(0,1,1)", 0.5],
    ]
