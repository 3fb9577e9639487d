"""Stage `plans_pull`: an overhand whose head was pulled out, as by hand (Sec. VII-E).

The paper's authors pulled the head segment out by hand before the pentagram was planned, for no
primitive has learned it. Here a rope is first tied along a topological path by a planner,
then its head is grasped and drawn away over the table, a few times. A pull is a spline like any
other: grasped at the very head, moved low in about the direction in which the head points. Of a
number of random pulls the one is kept that leaves the topological state as it is, every inner
segment long enough to work with, and the longest head. A person would not pull a rope into a shape
in which nothing can be done with it; so of a few ropes the one is taken in which aimed guesses at
the next action succeed most often. What ties the rope has no say in how it is pulled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.demonstrations import aim
from knotflow.planning import Goal, PlannerConfig, parse_goal, plan_knot
from knotflow.recording import RecordedRollout, write_index, write_recording
from knotflow.samplers import Sampler, SamplerConfig, build_sampler
from knotflow.simulation import (
    RopeSimulator,
    SimulationConfig,
    attempt,
    clip_splines,
    control_points,
    state_or_none,
    straight,
)
from knotflow.topology import TopologicalState, parse_action, segment_intervals
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import START_FILE
from knotflow.workflow.stages.recorder import Recorder

PULL = "pull"
"""Stands in a recording where a topological action's name stands; a pull is none."""


@dataclass
class PullConfig:
    """What is tied, and how its head is pulled."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator it is done in."""
    sampler: SamplerConfig = field(default_factory=lambda: SamplerConfig("aimed"))
    """The method that ties it; the stages it learns from are inputs of this one."""
    path: str = "R1(0,1,1) C(0,1,1) C(2,0,1)"
    """The topological path that ties the knot, from a straight rope."""
    head: float = 0.15
    """Length of rope from the head to the first crossing at which it is long enough, metres."""
    shortest_segment: float = 0.02
    """Least length between neighbouring crossings that a pull may leave, metres."""
    pulls: int = 24
    """Random pulls from which one is kept."""
    rounds: int = 4
    """Pulls in succession at most."""
    onward: str = "C(0,3,1)"
    """The action that the rope is to be ready for."""
    guesses: int = 32
    """Aimed guesses at it, by whose successes the ropes are compared."""
    knots: int = 4
    """Ropes tied and pulled, of which one is taken."""
    seed: int = 40
    """Of everything random."""


@stage("plans_pull", version=2)
def pull_out(config: PullConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes start.npy and start.csv with the rope (V, 3) in metres, and recordings/*.mcap.

    Raises:
        RuntimeError: no knot could be tied, or none whose head could be pulled out far enough.
    """
    simulator, rng = RopeSimulator(config.simulation), np.random.default_rng(config.seed)
    goal, onward = parse_goal(config.path, config.simulation.rope), parse_action(config.onward)
    sampler = build_sampler(config.sampler, inputs)
    recorder = Recorder(context, config.sampler.name, config.simulation.rope)
    pulled: list[RecordedRollout] = []
    ready: list[tuple[int, NDArray[np.float64]]] = []
    for _ in context.progress(range(config.knots), desc="pull"):
        points = _tie(goal, sampler, simulator, rng, recorder)
        state = TopologicalState.from_curve(points)
        for _ in range(config.rounds):
            if _head(points, config) >= config.head:
                break
            points = _pull(points, state, simulator, rng, config, pulled, context.signature)
        if _head(points, config) >= config.head:
            splines = aim(points, onward, config.guesses, rng)
            tried = attempt(simulator, points, splines, onward, state, recorder)
            ready.append((int(tried.success.sum()), points))
    if not ready:
        raise RuntimeError(
            f"no head could be pulled out to {config.head:g} m in {config.knots} knots; lower "
            "head, or raise pulls, rounds or knots"
        )
    points = max(ready, key=lambda one: one[0])[1]
    recorder.save("recordings/tie.mcap")
    if pulled:
        with context.atomic("recordings/pull.mcap") as path:
            write_recording(path, pulled, {"source": PULL, "signature": context.signature})
    write_index(context.out / "recordings")
    with context.atomic("start.csv") as path:
        pd.DataFrame(points, columns=["x", "y", "z"]).to_csv(path, index=False)
    with context.atomic(START_FILE) as path, path.open("wb") as file:
        np.save(file, points)


def _tie(
    goal: Goal,
    sampler: Sampler,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    recorder: Recorder,
) -> NDArray[np.float64]:
    """A tied rope (V, 3)."""
    search = PlannerConfig(batch=16, failure_discount=0.9)
    start = straight(simulator.config.rope)
    plan = plan_knot(start, goal, sampler, simulator, rng, search, observe=recorder)
    if not plan.solved:
        raise RuntimeError(f"the rope could not be tied to have its head pulled: {plan.reason}")
    return plan.shapes[-1]


def _pull(
    points: NDArray,
    state: TopologicalState,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: PullConfig,
    pulled: list[RecordedRollout],
    signature: str,
) -> NDArray[np.float64]:
    """The rope (V, 3) after the best of some random pulls, or as it was if none is any good."""
    outward = points[0, :2] - points[2, :2]
    angle = np.arctan2(outward[1], outward[0]) + rng.normal(0.0, 0.8, config.pulls)
    distance = rng.uniform(0.05, 0.3, config.pulls)[:, None]
    end = points[0, :2] + distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = (points[0, :2] + end) / 2
    height = np.full(config.pulls, 0.05)  # low: nothing shall be lifted off the table
    splines = clip_splines(np.column_stack([np.zeros(config.pulls), middle, height, end]))
    ropes = np.broadcast_to(points, (config.pulls, *points.shape))
    rollouts = simulator.execute(ropes, splines)
    controls = control_points(ropes, splines, config.simulation.rope.radius)
    best, longest = points, _head(points, config)
    for row, after in enumerate(rollouts.end_points):
        reached = None if rollouts.diverged[row] else state_or_none(after)
        pulled.append(
            RecordedRollout(
                times=rollouts.times,
                points=rollouts.trajectory[row],
                gripper=rollouts.gripper[row],
                control_points=controls[row],
                spline=splines[row],
                action=PULL,
                start_state=str(state),
                goal_state=str(state),
                end_state="" if reached is None else str(reached),
                outcome="diverged"
                if rollouts.diverged[row]
                else ("success" if reached == state else "failure"),
                signature=signature,
                source=PULL,
                # Beside the branches of the tying searches, which are numbered from 0 on.
                number=1_000_000 + len(pulled),
            )
        )
        if reached == state and _head(after, config) > longest:
            best, longest = after, _head(after, config)
    return best


def _head(points: NDArray, config: PullConfig) -> float:
    """Length from the head to the first crossing, metres; 0 where a segment is too short."""
    lengths = np.diff(segment_intervals(points), axis=1).ravel() * config.simulation.rope.length
    return float(lengths[0]) if lengths[1:-1].min() >= config.shortest_segment else 0.0
