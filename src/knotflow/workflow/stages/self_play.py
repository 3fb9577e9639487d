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
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, state_or_none
from knotflow.topology import TopologicalState, parse_action
from knotflow.training import SelfPlay, SelfPlayConfig, Transitions
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.curves import Curves

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
    curves = Curves(context, PART)
    if checkpoint := curves.checkpoint():
        training.load(checkpoint)
    bar = context.progress(
        total=config.training.rounds, initial=training.rounds_done, desc="self-play"
    )
    with bar:
        for one in training:
            for number, metrics in one.metrics.items():
                curves.add(number, metrics)
            bar.update()
            if training.rounds_done % SAVED_EVERY == 0:
                with curves.saving() as folder:
                    training.save(folder)
    curves.save()
    with context.atomic(FILE) as file:
        training.library.save(file)
    with context.atomic("trials.csv") as file:
        trials_table(training).to_csv(file, index=False)
    Curves.merge(context, [PART])  # last, for it drops the checkpoints


def trials_table(training: SelfPlay) -> pd.DataFrame:
    """The trials of every pair of state and action, and how many of them succeeded."""
    rows = [
        (str(state), str(action), record.trials, record.successes, record.rate)
        for (state, action), record in training.curriculum.records.items()
        if record.trials
    ]
    columns = ["start", "action", "trials", "successes", "recent_rate"]
    return pd.DataFrame(rows, columns=columns).sort_values(["start", "action"])


def earlier_attempts(folder: Path, count: int) -> list[Transitions]:
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
            Transitions(
                parse_action(action),
                before,
                points[legible],
                own[splines].to_numpy(np.float64)[legible],
                success[legible],
                ends[legible],
            )
        )
    return found
