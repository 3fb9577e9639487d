"""Motions of perturbed ropes, from which dynamics are learned and by which they are judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations import (
    Demonstration,
    NoiseConfig,
    heuristic_any_action,
    noisy_copies,
)
from knotflow.simulation import (
    LEVELS,
    RopeSimulator,
    SimulationConfig,
    grasped_link,
    perturb_rope,
    random_curve,
    state_or_none,
)
from knotflow.topology import TopologicalState

STEP = 0.1
"""Seconds from one frame to the next; a step of all dynamics."""

FREE = -1
"""Stands for the index of the grasped link where no link is."""

ACTIONS_PER_CURVE = 4
"""Splines that move a random curve one after the other: an overhand takes three actions."""

MAX_CROSSINGS = 4
"""A rope with more is left, and another one taken."""

RANDOM_SHARE = 0.25
"""Of the splines that move random curves."""


@dataclass(frozen=True, eq=False)
class Motions:
    """Ropes dragged by a gripper and let go; metres, world frame, frames `STEP` apart.

    Attributes:
        points: (N, T, V, 3) rope vertices.
        gripper: (N, T, 3) gripper positions.
        grasped: (N, T) index of the link that is held until the next frame, or `FREE`.
        level: (N,) how far the rope may be from the planner's.
    """

    points: NDArray[np.float32]
    gripper: NDArray[np.float32]
    grasped: NDArray[np.int64]
    level: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: NDArray | slice) -> Motions:
        return Motions(*(value[rows] for value in vars(self).values()))

    def save(self, path: Path) -> None:
        """Write an NPZ file."""
        np.savez(path, **vars(self))

    @classmethod
    def load(cls, path: Path) -> Motions:
        """Read what `save` wrote."""
        with np.load(path) as file:
            return cls(**file)

    @classmethod
    def join(cls, parts: Sequence[Motions]) -> Motions:
        """All motions of several sets."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))


def draw_motions(
    demonstrations: Sequence[Demonstration],
    config: SimulationConfig,
    ropes: int,
    per_rope: int,
    rng: np.random.Generator,
    levels: Sequence[int] = LEVELS,
) -> Iterator[Motions]:
    """Motions of perturbed ropes, a rope at a time; levels take turns.

    Half begin where a demonstration does: a quarter with copies of its spline with noise, a quarter
    with one aimed at any action. The others are as in plans: random curves, moved by
    `ACTIONS_PER_CURVE` splines one after the other, aimed at an action or, of four, one random.
    """
    for number in range(ropes):
        level = levels[number % len(levels)]
        rope = perturb_rope(config.rope, level, rng)
        simulator = RopeSimulator(replace(config, rope=rope, record_rate=1 / config.timestep))
        raised = np.array([0.0, 0.0, rope.radius - config.rope.radius])
        demonstrated = [
            _demonstrated(demonstrations, copy=kind % 2 == 0, rng=rng)
            for kind in range(per_rope // 2)
        ]
        if demonstrated:
            starts, splines = (np.stack(part) for part in zip(*demonstrated, strict=True))
            yield _execute(simulator, starts + raised, splines, level)[0]
        remaining = per_rope - len(demonstrated)
        curves = -(-remaining // ACTIONS_PER_CURVE)
        points = [random_curve(config.rope, rng) + raised for _ in range(curves)]
        while remaining > 0:
            points = points[:remaining]
            remaining -= len(points)
            states = [TopologicalState.from_curve(one) for one in points]
            splines = np.stack(
                [
                    heuristic_any_action(one, state, rng, RANDOM_SHARE)
                    for one, state in zip(points, states, strict=True)
                ]
            )
            motions, ends = _execute(simulator, np.stack(points), splines, level)
            yield motions
            points = [
                end - [*end[:, :2].mean(axis=0), 0.0]
                if (state := state_or_none(end)) is not None
                and state.num_crossings <= MAX_CROSSINGS
                else random_curve(config.rope, rng) + raised
                for end in ends
            ]


def _demonstrated(
    demonstrations: Sequence[Demonstration], copy: bool, rng: np.random.Generator
) -> tuple[NDArray, NDArray]:
    """A demonstrated start (V, 3), and a noisy copy of its spline or one aimed elsewhere (6,)."""
    one = demonstrations[int(rng.integers(len(demonstrations)))]
    if copy:
        return one.points, noisy_copies(one.spline, 1, rng, NoiseConfig())[0]
    return one.points, heuristic_any_action(one.points, one.task.start_state, rng)


def _execute(
    simulator: RopeSimulator, points: NDArray, splines: NDArray, level: int
) -> tuple[Motions, NDArray[np.float64]]:
    """The motions that did not diverge, and the ends (B, V, 3) of all."""
    config = simulator.config
    rollouts = simulator.execute(points, splines)
    frames = np.arange(0, len(rollouts.times), round(STEP / config.timestep))
    held = rollouts.times[frames] < config.move_time - 1e-6
    link = grasped_link(splines, config.rope.links)
    grasped = np.where(held, link[:, None], FREE)
    kept = np.flatnonzero(~rollouts.diverged)
    motions = Motions(
        rollouts.trajectory[kept[:, None], simulated_frames(frames, len(rollouts.times))],
        rollouts.gripper[kept[:, None], frames],
        grasped[kept],
        np.full(len(kept), level),
    )
    return motions, rollouts.end_points


def simulated_frames(steps: NDArray[np.intp], frames: int) -> NDArray[np.intp]:
    """Which of a simulator's frames, one a time step, show ropes as they are after so many steps.

    They come a time step early (see `Rollouts.trajectory`), so it is each time the next one; but
    for the start, and for the end, of which there is no later one and at which the rope rests.
    """
    return np.where(steps > 0, np.minimum(steps + 1, frames - 1), 0)
