"""Motions of perturbed ropes, from which dynamics are learned and by which they are judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.demonstrations import Demonstration, NoiseConfig, aim, noisy_copies
from knotflow.simulation import (
    LEVELS,
    SPLINE_HIGH,
    SPLINE_LOW,
    RopeSimulator,
    SimulationConfig,
    grasped_link,
    perturb_rope,
    random_curve,
)
from knotflow.topology import TopologicalState

STEP = 0.1
"""Seconds from one frame to the next; a step of all dynamics."""

FREE = -1
"""Stands for the index of the grasped link where no link is."""


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
        return cls(
            **{name: np.concatenate([vars(p)[name] for p in parts]) for name in vars(parts[0])}
        )


def draw_motions(
    demonstrations: Sequence[Demonstration],
    config: SimulationConfig,
    ropes: int,
    per_rope: int,
    rng: np.random.Generator,
    levels: Sequence[int] = LEVELS,
) -> Iterator[Motions]:
    """Motions of perturbed ropes, a rope at a time; levels take turns.

    A quarter each are copies of demonstrated splines with noise, splines aimed at any action that
    the demonstrated start allows, splines aimed at a loop in a random curve, and random splines.
    """
    for number in range(ropes):
        level = levels[number % len(levels)]
        rope = perturb_rope(config.rope, level, rng)
        simulator = RopeSimulator(replace(config, rope=rope, record_rate=1 / config.timestep))
        pairs = [_pair(demonstrations, config, kind % 4, rng) for kind in range(per_rope)]
        starts = np.stack([start for start, _ in pairs])
        starts[..., 2] += rope.radius - config.rope.radius
        splines = np.stack([spline for _, spline in pairs])
        rollouts = simulator.execute(starts, splines)
        frames = np.arange(0, len(rollouts.times), round(STEP / config.timestep))
        held = rollouts.times[frames] < config.move_time - 1e-6
        link = grasped_link(splines, rope.links)
        grasped = np.where(held, link[:, None], FREE)
        kept = np.flatnonzero(~rollouts.diverged)[:, None]
        yield Motions(
            rollouts.trajectory[kept, simulated_frames(frames, len(rollouts.times))],
            rollouts.gripper[kept, frames],
            grasped[kept[:, 0]],
            np.full(len(kept), level),
        )


def simulated_frames(steps: NDArray[np.intp], frames: int) -> NDArray[np.intp]:
    """Which of a simulator's frames, one a time step, show ropes as they are after so many steps.

    They come a time step early (see `Rollouts.trajectory`), so it is each time the next one; but
    for the start, and for the end, of which there is no later one and at which the rope rests.
    """
    return np.where(steps > 0, np.minimum(steps + 1, frames - 1), 0)


def _pair(
    demonstrations: Sequence[Demonstration],
    config: SimulationConfig,
    kind: int,
    rng: np.random.Generator,
) -> tuple[NDArray, NDArray]:
    """A start (V, 3) and a spline (6,)."""
    shown = demonstrations[int(rng.integers(len(demonstrations)))]
    if kind == 0:
        return shown.points, noisy_copies(shown.spline, 1, rng, NoiseConfig())[0]
    points = shown.points if kind == 1 else random_curve(config.rope, rng)
    if kind == 3:
        return points, rng.uniform(SPLINE_LOW, SPLINE_HIGH)
    state = shown.task.start_state if kind == 1 else TopologicalState.trivial()
    actions = [action for action, _ in state.actions()]
    return points, aim(points, actions[rng.integers(len(actions))], 1, rng)[0]
