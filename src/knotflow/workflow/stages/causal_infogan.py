"""Stage `causal_infogan`: models trained on successful demonstrated rollouts (Sec. VII-C)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.recording import load, read_recording
from knotflow.samplers.causal_infogan import (
    CausalInfoGanBudget,
    CausalInfoGanConfig,
    DemonstratedRollouts,
    frames_at,
)
from knotflow.samplers.causal_infogan.health import Health
from knotflow.samplers.causal_infogan.networks import save_model
from knotflow.samplers.demonstrations import TASKS, task
from knotflow.training.causal_infogan import CausalInfoGanTrainer
from knotflow.training.trainer import CURVES, run_training
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass
class CausalInfoGanStageConfig:
    """What is learned from, and how often."""

    network: CausalInfoGanConfig = field(default_factory=CausalInfoGanConfig)
    """Networks and training."""
    actions: list[str] = field(default_factory=list)
    """Actions whose rollouts are learned from; none given is all eight."""
    seeds: int = CausalInfoGanBudget.seeds
    """Models, with seeds 0, 1 and so on."""


@stage("causal_infogan", inputs=("demonstrations",))
def train(
    config: CausalInfoGanStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes models/<seed>.pt, training.csv (the curves) and seeds.csv (which have collapsed).

    A training that is interrupted goes on from its last checkpoint and ends the same.
    """
    seeds = [str(seed) for seed in range(config.seeds)]
    pending = context.pending([f"models/{seed}" for seed in seeds], ".pt")
    work = partial(_train, config, dict(inputs))
    context.each(work, [int(Path(shard).name) for shard in pending], "causal_infogan")
    curves = []
    for seed in seeds:
        curve = pd.read_csv(context.out / f"seed-{seed}" / CURVES)
        curve.insert(0, "seed", int(seed))
        health = curve[[one.name for one in fields(Health)]]
        curve["collapsed"] = [
            " ".join(Health(**row).collapsed) for row in health.to_dict("records")
        ]
        curves.append(curve)
    with context.atomic("training.csv") as path:
        pd.concat(curves).to_csv(path, index=False)
    with context.atomic("seeds.csv") as path:
        pd.concat([curve.tail(1) for curve in curves]).to_csv(path, index=False)


def _train(
    config: CausalInfoGanStageConfig, inputs: Mapping[str, Path], context: StageContext, seed: int
) -> None:
    network = config.network
    actions = [str(task(one).action) for one in config.actions] or [str(t.action) for t in TASKS]
    rollouts = load_rollouts(inputs["demonstrations"], actions, network.frame_rate)
    shapes = rollouts.in_start_frames()
    trainer = CausalInfoGanTrainer(shapes, rollouts.starts, network, seed)

    def finish() -> None:
        with context.atomic(f"models/{seed}.pt") as path:
            save_model(path, trainer.model, actions)

    def log(name: str, value: float, step: int) -> None:
        context.logger.log_scalar(f"seed_{seed}/{name}", value, step)

    run_training(
        trainer, context.out / f"seed-{seed}", name=f"causal_infogan, seed {seed}",
        progress=context.progress, finish=finish, log=log,
    )  # fmt: skip


def load_rollouts(
    demonstrations: Path, actions: Sequence[str], frame_rate: float, most: int = 0
) -> DemonstratedRollouts:
    """Of the output of a `demonstrations` stage; failures are no demonstrations.

    Args:
        demonstrations: the stage's folder.
        actions: that are wanted.
        frame_rate: frames per second.
        most: if given, so many of them, spread evenly over the files.

    Raises:
        ValueError: not one rollout of these actions succeeded.
    """
    index = load(demonstrations / "recordings")
    index = index[index["action"].isin(list(actions)) & (index["outcome"] == "success")]
    if index.empty:
        raise ValueError(
            f"no rollout of {', '.join(actions)} in {demonstrations} succeeded, so there is "
            "nothing to learn from; simulate more copies (demonstrations.copies)"
        )
    if most:
        index = index.iloc[np.unique(np.linspace(0, len(index) - 1, most).astype(int))]
    names: list[str] = []
    starts: list[int] = []
    shapes: list[NDArray] = []
    for file, of_file in index.groupby("file", sort=True):
        wanted = set(of_file["number"])
        for rollout in read_recording(str(file)):
            if rollout.number in wanted:
                frames = frames_at(rollout.times, frame_rate)
                names.append(rollout.action)
                starts.append(int(rollout.extra["start"]))
                shapes.append(rollout.points[frames])
    return DemonstratedRollouts(np.array(names), np.array(starts), np.stack(shapes))
