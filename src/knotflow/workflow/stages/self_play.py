"""Stage `self_play`: the primitives learn all actions together (Sec. V-B c, and beyond).

Its trials, tens of thousands, are not recorded: they would be gigabytes. Their counts
are, and one command reproduces them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.recording import load
from knotflow.samplers.demonstrations import TASKS, load_trials
from knotflow.samplers.primitives import FILE, PrimitiveLibrary
from knotflow.simulation import (
    Attempts,
    Rollouts,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    state_or_none,
)
from knotflow.topology import TopologicalState, parse_action
from knotflow.training import SelfPlay, SelfPlayConfig
from knotflow.training.trainer import CURVES, merge_curves, run_training
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage

PART = "self_play"
SAVED_EVERY = 25
"""Rounds between two checkpoints."""


@dataclass(kw_only=True)
class SelfPlayStageConfig:
    """How long, and on what rope."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the trials."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What an untangled rope looks like."""
    training: SelfPlayConfig = field(default_factory=SelfPlayConfig)
    """The effort."""
    seed: int
    """Of everything random."""


@stage("self_play", version=2, inputs=("demonstrations", "primitives"))
def play(config: SelfPlayStageConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes primitives.safetensors, curves.csv and trials.csv, a row for each pair of state and
    action that was tried."""
    demonstrated = load_trials(inputs["demonstrations"])
    recordings = inputs["primitives"] / "recordings"  # none of a library from a file
    training = SelfPlay(
        PrimitiveLibrary.load(inputs["primitives"] / FILE, config.simulation.rope),
        {task: demonstrated[task.action] for task in TASKS},
        earlier_attempts(recordings, config.training.memory) if recordings.exists() else (),
        RopeSimulator(config.simulation),
        config.training,
        config.seed,
        config.starts,
    )

    def finish() -> None:
        with context.atomic(FILE) as file:
            training.library.save(file)
        with context.atomic("trials.csv") as file:
            trials_table(training).to_csv(file, index=False)
        with context.atomic(CURVES) as file:
            curves = merge_curves({1: context.out / PART / CURVES})
            curves.to_csv(file, index=False, float_format="%.6g")

    run_training(
        training, context.out / PART, name="self-play", progress=context.progress,
        save_every=SAVED_EVERY, finish=finish, log=context.logger.log_scalar,
    )  # fmt: skip


def trials_table(training: SelfPlay) -> pd.DataFrame:
    """The trials of every pair of state and action, and how many of them succeeded."""
    rows = [
        (str(state), str(action), pair.trials, pair.successes, pair.rate)
        for (state, action), pair in training.curriculum.stats.items()
    ]
    columns = ["start", "action", "trials", "successes", "recent_rate"]
    return pd.DataFrame(rows, columns=columns).sort_values(["start", "action"])


def earlier_attempts(folder: Path, count: int) -> list[Attempts]:
    """The newest `count` attempts of each action among the recordings of a stage.

    Shapes are recorded in single precision; the few whose state this changes are left out.

    Raises:
        FileNotFoundError: there are no recordings.
    """
    table = load(folder)
    newest = table.sort_values("number").groupby(["action", "start_state"]).tail(count)
    if newest.empty:
        return []
    rollouts = load(sorted(newest["file"].unique()), trajectories=True)
    rollouts = rollouts[rollouts["number"].isin(newest["number"])].sort_values("number")
    splines = [name for name in rollouts if name.startswith("spline_")]
    found = []
    for (action, start), own in rollouts.groupby(["action", "start_state"], sort=True):
        before = TopologicalState.parse(start)
        after = before.apply(parse_action(action))
        points = np.stack([points[0] for points in own["points"]]).astype(np.float64)
        ends = np.stack([points[-1] for points in own["points"]]).astype(np.float64)
        success = (own["outcome"] == "success").to_numpy()
        legible = np.array(
            [
                state_or_none(one) == before and (not hit or state_or_none(other) == after)
                for one, other, hit in zip(points, ends, success, strict=True)
            ]
        )
        found.append(
            Attempts.of(
                parse_action(action),
                before,
                points[legible],
                own[splines].to_numpy(np.float64)[legible],
                _first_and_last(points[legible], ends[legible]),
                [after if hit else None for hit in success[legible]],
            )
        )
    return found


def _first_and_last(points: np.ndarray, ends: np.ndarray) -> Rollouts:
    """Rollouts of which only the first and the last frame are known."""
    frames = np.stack([points, ends], axis=1).astype(np.float32)
    nowhere = np.full((len(points), 2, 3), np.nan, np.float32)
    return Rollouts(np.array([0.0, 1.0]), frames, nowhere, ends, np.zeros(len(points), bool))
