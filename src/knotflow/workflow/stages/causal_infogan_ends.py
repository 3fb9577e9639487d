"""Stage `causal_infogan_ends`: end shapes known to be reachable from unseen starts (Sec. VII-C).

"Causal InfoGAN requires the end configuration to be given, and we guarantee there is a feasible
path." The guarantee is a rollout: aimed guesses, a proposal of neither side of the comparison, are
executed from each start until one reaches the goal state, and the rope at rest is the end shape.
Starts without one are left out and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.demonstrations import TASKS, aim, task
from knotflow.recording import write_index
from knotflow.simulation import Attempts, RopeSimulator, SimulationConfig, attempt
from knotflow.topology import Action, TopologicalState, segment_intervals
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder
from knotflow.workflow.stages.starts import load_starts

FOCUS = "C(0,1,1)"
OVERHAND = "overhand"
_LAST = task("C(2,0,1)")


@dataclass(frozen=True)
class Goal:
    """A start state and the actions to execute from there."""

    name: str
    """As in the tables: an action, or "overhand"."""
    first: str
    """The action whose unseen starts are taken."""
    actions: tuple[Action, ...]
    """To be executed one after the other."""

    @property
    def file(self) -> str:
        """The goal as a file name."""
        return task(self.first).name if len(self.actions) == 1 else self.name

    @property
    def start_state(self) -> TopologicalState:
        """The state of the starts."""
        return task(self.first).start_state


GOALS: tuple[Goal, ...] = (
    *(Goal(str(one.action), str(one.action), (one.action,)) for one in TASKS),
    # The overhand of Sec. VII-A4: R1(0,1,1), C(0,1,1), C(2,0,1).
    Goal(OVERHAND, str(_LAST.start_actions[0]), (*_LAST.start_actions, _LAST.action)),
)
"""The eight actions of Fig. 6 and the multi-stage overhand."""


@dataclass
class CausalInfoGanEndsConfig:
    """How hard end shapes are sought."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the guesses."""
    starts: int = 50
    """Starts of C(0,1,1) at most."""
    starts_other: int = 16
    """Starts of each other action at most."""
    starts_overhand: int = 16
    """Starts of the overhand at most."""
    guesses: int = 16
    """Guesses executed at a time."""
    rounds: int = 6
    """Times that so many guesses are executed for each action before a start is left out."""
    seed: int = 11
    """Of the guesses."""

    def starts_of(self, goal: Goal) -> int:
        """How many starts of a goal are tried at most."""
        special = {FOCUS: self.starts, OVERHAND: self.starts_overhand}
        return special.get(goal.name, self.starts_other)

    def guesses_of(self, goal: Goal) -> int:
        """How many guesses are executed from one start of a goal at most."""
        return self.guesses * self.rounds * len(goal.actions)


@stage("causal_infogan_ends", version=1, inputs=("starts",))
def seek(
    config: CausalInfoGanEndsConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes <goal>.npz with start (N,), points and ends (N, V, 3); ends.csv and recordings."""
    names = [goal.file for goal in GOALS]
    work = partial(_seek, config, dict(inputs))
    context.each(work, context.pending(names, ".npz"), "reachable ends")
    rows = []
    for goal in GOALS:
        with np.load(context.out / f"{goal.file}.npz") as file:
            rows.append((goal.name, int(file["tried"]), len(file["start"])))
    with context.atomic("ends.csv") as path:
        pd.DataFrame(rows, columns=["goal", "starts", "reached"]).to_csv(path, index=False)
    write_index(context.out / "recordings")


def _seek(
    config: CausalInfoGanEndsConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> None:
    number = [goal.file for goal in GOALS].index(name)
    goal, rng = GOALS[number], np.random.default_rng([config.seed, number])
    starts = load_starts(inputs["starts"], task(goal.first))[: config.starts_of(goal)]
    # Numbers are unique in the stage: leave room for all guesses of the goals before.
    first = sum(config.starts_of(one) * config.guesses_of(one) for one in GOALS[:number])
    recorder = Recorder(context, "aim", config.simulation.rope, first)
    propose = partial(_propose, config.guesses, rng, RopeSimulator(config.simulation), recorder)
    found = {}
    for start, points in enumerate(starts):
        recorder.extra = {"start": str(start), "goal": goal.name}
        batches = iter(range(config.rounds * len(goal.actions)))
        end = _reach(points, goal.start_state, goal.actions, propose, batches, config.rounds)
        if end is not None:
            found[start] = (points, end)
    recorder.save(f"recordings/{name}.mcap")
    shape = (len(found), *starts.shape[1:])
    with context.atomic(f"{name}.npz") as path:
        np.savez_compressed(
            path,
            tried=len(starts),
            start=np.array(list(found), dtype=np.intp),
            points=np.array([one for one, _ in found.values()]).reshape(shape),
            ends=np.array([end for _, end in found.values()]).reshape(shape),
        )


def load_ends(folder: Path, goal: Goal) -> tuple[NDArray, NDArray, NDArray]:
    """Numbers (N,) of the starts that have an end, these starts and ends (N, V, 3), metres."""
    with np.load(folder / f"{goal.file}.npz") as file:
        return file["start"], file["points"], file["ends"]


Propose = Callable[[NDArray, Action, TopologicalState], Attempts]
"""Guesses for an action on a rope (V, 3) in a state, executed."""


def _propose(
    count: int,
    rng: np.random.Generator,
    simulator: RopeSimulator,
    recorder: Recorder,
    points: NDArray,
    action: Action,
    state: TopologicalState,
) -> Attempts:
    return attempt(simulator, points, aim(points, action, count, rng), action, state, recorder)


def _reach(
    points: NDArray,
    state: TopologicalState,
    actions: Sequence[Action],
    propose: Propose,
    batches: Iterator[int],
    rounds: int,
) -> NDArray | None:
    """The rope (V, 3) after the actions, None where the guesses ran out.

    At most `rounds` batches are spent on an action after one success of the action before; another
    success is then sought, as long as there are `batches`.
    """
    if not actions:
        return points
    for _ in islice(batches, rounds):
        tried = propose(points, actions[0], state)
        if tried.success.any():
            best = _roomiest(tried.rollouts.end_points[tried.success])
            after = state.apply(actions[0])
            end = _reach(best, after, actions[1:], propose, batches, rounds)
            if end is not None:
                return end
    return None


def _roomiest(shapes: NDArray) -> NDArray:
    """Of ropes (N, V, 3) the one whose shortest segment is longest: it is easiest to go on from."""
    return max(shapes, key=lambda points: np.diff(segment_intervals(points), axis=1).min())
