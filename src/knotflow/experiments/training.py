"""Training of the primitives: imitation, reinforcement, joint finetuning, self-play (Sec. V-B)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.experiments.common import Recorder, read_by_training, train
from knotflow.experiments.demonstrations import load_starts
from knotflow.recording import load
from knotflow.samplers.demonstrations import SHIPPED, TASKS, Task, load_trials
from knotflow.samplers.primitives import (
    FILE,
    PRIMITIVES,
    PrimitiveConfig,
    PrimitiveLibrary,
    primitive_of,
)
from knotflow.simulation import (
    Attempts,
    Rollouts,
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    Trials,
    state_or_none,
)
from knotflow.topology import Action, TopologicalState, parse_action
from knotflow.training import (
    Imitation,
    ImitationConfig,
    JointConfig,
    JointFinetuning,
    KnotFinetuning,
    KnotsConfig,
    Reinforcement,
    ReinforcementConfig,
    SelfPlay,
    SelfPlayConfig,
    completed,
)
from knotflow.training.trainer import CURVES, merge_curves
from knotflow.workflow import StageRun, stage

TOGETHER = "training"
"""Folder of the checkpoint where primitives learn together."""
PARTS = {f"primitive-{number}": number for number in PRIMITIVES}


@stage
def imitation(
    run: StageRun,
    *,
    demonstrations: Path,
    rope: RopeConfig,
    primitive: PrimitiveConfig,
    imitation_training: ImitationConfig,
    training_seed: int,
) -> None:
    """Four primitives learn from the demonstrations; one shard a primitive.

    Makes primitives.safetensors and curves.csv.
    """

    def imitate(part: str) -> None:
        number = PARTS[part]
        trials = demonstrated(number, load_trials(demonstrations))
        trainer = Imitation(
            [*trials.values()], primitive, imitation_training, training_seed + number
        )

        def save(path: Path) -> None:
            PrimitiveLibrary({number: trainer.primitive}, {number: [*trials]}, rope).save(path)

        name, weights = f"imitation {number}", f"{part}.safetensors"
        train(run, trainer, name, weights, save, folder=part, save_every=10)

    run.each(imitate, run.pending([*PARTS], ".safetensors"), "imitation")
    _merge(run)


def demonstrated(
    number: int, trials: Mapping[Action, Sequence[Trials]]
) -> dict[Action, list[Trials]]:
    """Of all trials those that a primitive, 1 to 4, learns from.

    Actions beyond the eight tasks are among them, if somebody has demonstrated some.

    Raises:
        ValueError: there are none.
    """
    chosen: dict[Action, list[Trials]] = {}
    for action, some in trials.items():
        own = [one for one in some if primitive_of(action, one.start.num_segments) == number]
        if own:
            chosen[action] = own
    if not chosen:
        raise ValueError(
            f"there is no demonstration for primitive {number}, which learns "
            f"{', '.join(str(task.action) for task in tasks_of(number))} and the like; demonstrate "
            f"one, or merge the file with the shipped demonstrations: knotflow merge FILE {SHIPPED}"
        )
    return chosen


def tasks_of(number: int) -> list[Task]:
    """The tasks of a primitive, 1 to 4."""
    return [
        task for task in TASKS if primitive_of(task.action, task.start_state.num_segments) == number
    ]


@stage
def reinforcement(
    run: StageRun,
    *,
    demonstrations: Path,
    imitation: Path,
    pools: Path,
    simulation: SimulationConfig,
    starts: StartsConfig,
    reinforcement_training: ReinforcementConfig,
    training_seed: int,
) -> None:
    """The primitives continue with their own attempts; one shard a primitive.

    Makes primitives.safetensors, curves.csv and recordings/*.mcap, one a primitive and round.
    """
    rope = simulation.rope

    def reinforce(part: str) -> None:
        number = PARTS[part]
        tasks, trials = tasks_of(number), load_trials(demonstrations)

        def record(index: int, attempts: Sequence[Attempts]) -> None:
            first = number * 1_000_000 + index * sum(map(len, attempts))
            recorder = Recorder(run, "reinforcement", rope, first)
            for some in attempts:
                recorder(some)
            recorder.save(f"recordings/{part}-{index:03d}.mcap")

        trainer = Reinforcement(
            PrimitiveLibrary.load(imitation / FILE, rope).primitives[number],
            [one for task in tasks for one in trials[task.action]],
            {task: load_starts(pools, str(task.start_state)) for task in tasks},
            RopeSimulator(simulation),
            reinforcement_training,
            training_seed + number,
            starts,
            record,
        )

        def save(path: Path) -> None:
            actions = {number: [task.action for task in tasks]}
            PrimitiveLibrary({number: trainer.primitive}, actions, rope).save(path)

        name, weights = f"reinforcement {number}", f"{part}.safetensors"
        train(run, trainer, name, weights, save, folder=part, save_every=4)

    run.each(reinforce, run.pending([*PARTS], ".safetensors"), "reinforcement")
    _merge(run)


@stage
def policy_success(run: StageRun, *, trainings: Mapping[str, Path]) -> None:
    """The success rates of policies in training, the names of the inputs being method and seed.

    Makes curves.csv.
    """
    curves = read_by_training(trainings, CURVES)
    own = curves["metric"].str.startswith("policy_success/")
    columns = ["method", "training_seed", "step", "metric", "value"]
    run.save_table(CURVES, curves.loc[own, columns], "%.4g")


def _merge(run: StageRun) -> None:
    """Bring the parts of a library, and their curves, into one file each."""
    with run.atomic(FILE) as path:
        libraries = [PrimitiveLibrary.load(run.out / f"{part}.safetensors") for part in PARTS]
        PrimitiveLibrary.merged(libraries).save(path)
    curves = {number: run.out / part / CURVES for part, number in PARTS.items()}
    run.save_table(CURVES, merge_curves(curves), "%.6g")


@stage
def joint(
    run: StageRun,
    *,
    demonstrations: Path,
    primitives: Path,
    attempts: Path,
    simulation: SimulationConfig,
    starts: StartsConfig,
    joint_training: JointConfig,
    training_seed: int,
) -> None:
    """The primitives learn together on episodes that tie a knot (Sec. V-B c).

    Makes primitives.safetensors and curves.csv. The splines are not recorded.

    `attempts` are recordings of earlier attempts, which are remembered.
    """
    trainer = JointFinetuning(
        PrimitiveLibrary.load(primitives / FILE, simulation.rope),
        load_trials(demonstrations),
        earlier_attempts(attempts / "recordings", joint_training.memory),
        RopeSimulator(simulation),
        joint_training,
        training_seed,
        starts,
    )

    def save(path: Path) -> None:
        trainer.library.save(path)
        _save_curves(run)

    train(run, trainer, "joint finetuning", FILE, save, folder=TOGETHER, save_every=5)


@stage
def self_play(
    run: StageRun,
    *,
    demonstrations: Path,
    primitives: Path,
    attempts: Path,
    simulation: SimulationConfig,
    starts: StartsConfig,
    self_play_training: SelfPlayConfig,
    training_seed: int,
) -> None:
    """The primitives learn all actions together, from ropes that they made.

    Makes primitives.safetensors, curves.csv and trials.csv, a row a pair of state and action. The
    trials, tens of thousands, are not recorded.

    `attempts` are recordings of earlier attempts, which are remembered.
    """
    trainer = SelfPlay(
        completed(PrimitiveLibrary.load(primitives / FILE, simulation.rope), training_seed),
        load_trials(demonstrations),
        earlier_attempts(attempts / "recordings", self_play_training.memory),
        RopeSimulator(simulation),
        self_play_training,
        training_seed,
        starts,
    )

    def save(path: Path) -> None:
        trainer.library.save(path)
        _save_curves(run)
        rows = [
            (str(state), str(action), pair.trials, pair.successes, pair.rate)
            for (state, action), pair in trainer.curriculum.stats.items()
        ]
        columns = ["start", "action", "trials", "successes", "recent_rate"]
        table = pd.DataFrame(rows, columns=columns).sort_values(["start", "action"])
        run.save_table("trials.csv", table)

    train(run, trainer, "self-play", FILE, save, folder=TOGETHER, save_every=25)


@stage
def knot_finetuning(
    run: StageRun,
    *,
    demonstrations: Path,
    primitives: Path,
    attempts: Path,
    simulation: SimulationConfig,
    starts: StartsConfig,
    knots_training: KnotsConfig,
    training_seed: int,
) -> None:
    """The primitives learn together on episodes that tie many knots, on any rope.

    Makes primitives.safetensors and curves.csv. The splines are not recorded.

    `attempts` are recordings of earlier attempts, which are remembered.
    """
    trainer = KnotFinetuning(
        PrimitiveLibrary.load(primitives / FILE, simulation.rope),
        load_trials(demonstrations),
        earlier_attempts(attempts / "recordings", knots_training.memory),
        RopeSimulator(simulation),
        knots_training,
        training_seed,
        starts,
    )

    def save(path: Path) -> None:
        trainer.library.save(path)
        _save_curves(run)

    train(run, trainer, "finetuning on knots", FILE, save, folder=TOGETHER, save_every=5)


def _save_curves(run: StageRun) -> None:
    """The curves of primitives that learn together; those of none of them are primitive 1's."""
    run.save_table(CURVES, merge_curves({1: run.out / TOGETHER / CURVES}), "%.6g")


def earlier_attempts(folder: Path, count: int) -> list[Attempts]:
    """The newest `count` attempts of each action among the recordings of a stage.

    Shapes are recorded in single precision; the few whose state this changes are left out.
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
                Rollouts.between(points[legible], ends[legible]),
                [after if hit else None for hit in success[legible]],
            )
        )
    return found


@stage
def shipped_library(run: StageRun, *, primitives: Path) -> None:
    """A trained library as files small enough to be kept with the source.

    Makes primitives/primitive-<number>.safetensors in half precision.
    """
    library = PrimitiveLibrary.load(primitives / FILE)
    with run.atomic("primitives") as folder:
        folder.mkdir()
        for number, primitive in library.primitives.items():
            one = copy(library)
            one.primitives = {number: primitive}
            one.trained_on = {number: library.trained_on[number]}
            one.save(folder / f"primitive-{number}.safetensors", half=True)
