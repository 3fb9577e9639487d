"""Stage `joint_finetuning`: primitives learn together, on episodes along one path (Sec. V-B c)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from knotflow.demonstrations import TASKS, load_trials
from knotflow.primitives import FILE, PrimitiveLibrary
from knotflow.recording import load, write_index
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, state_or_none
from knotflow.topology import TopologicalState, parse_action
from knotflow.training import JointConfig, JointFinetuning, Transitions, parse_path
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.curves import Curves
from knotflow.workflow.stages.recorder import Recorder

PART = "joint"


@dataclass(kw_only=True)
class JointFinetuningConfig:
    """Which path, how long, and on what rope."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the episodes."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What an untangled rope looks like."""
    path: str
    """Actions from the untangled rope to the knot."""
    joint: JointConfig = field(default_factory=JointConfig)
    """The effort."""
    seed: int
    """Of everything random."""


@stage("joint_finetuning", inputs=("demonstrations", "reinforcement"))
def finetune(
    config: JointFinetuningConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes primitives.safetensors, curves.csv and recordings/*.mcap, one a round.

    Primitives that the path does not need are those of the input. A round that was interrupted is
    simulated again, to the same rollouts, and replaces its file.
    """
    path, rope = parse_path(config.path), config.simulation.rope
    demonstrated = load_trials(inputs["demonstrations"])
    library = PrimitiveLibrary.load(inputs["reinforcement"] / FILE, rope)
    training = JointFinetuning(
        library,
        path,
        {task: demonstrated[task.action] for task in TASKS},
        earlier_attempts(inputs["reinforcement"] / "recordings", config.joint.memory),
        RopeSimulator(config.simulation),
        config.joint,
        config.seed,
        config.starts,
    )
    curves = Curves(context, PART)
    if checkpoint := curves.checkpoint():
        training.load(checkpoint)
    most = len(path) * config.joint.episodes * config.joint.tries
    _train(training, most, curves, config, context)
    with context.atomic(FILE) as file:
        library.save(file)
    write_index(context.out / "recordings")
    Curves.merge(context, [PART])  # last, for it drops the checkpoints


def _train(
    training: JointFinetuning,
    most_rollouts: int,
    curves: Curves,
    config: JointFinetuningConfig,
    context: StageContext,
) -> None:
    """Run the rounds that are left; a round has at most so many rollouts."""
    bar = context.progress(
        total=config.joint.rounds, initial=training.rounds_done, desc="joint finetuning"
    )
    with bar:
        for one in training:
            for number, metrics in one.metrics.items():
                curves.add(number, metrics)
            rope = config.simulation.rope
            recorder = Recorder(context, "joint_finetuning", rope, one.index * most_rollouts)
            for attempts in one.attempts:
                recorder(attempts)
            recorder.save(f"recordings/{PART}-{one.index:03d}.mcap")
            bar.update()
            if training.rounds_done % 4 == 0:
                with curves.saving() as folder:
                    training.save(folder)
    curves.save()


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
