"""Motions of perturbed ropes, to train and judge dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.arrays import repeat_last
from knotflow.samplers.demonstrations import (
    Demonstration,
    NoiseConfig,
    heuristic_any_action,
    noisy_copies,
)
from knotflow.simulation import (
    RopeSimulator,
    SimulationConfig,
    grasped_link,
    perturb_rope,
    random_curve,
    state_or_none,
)
from knotflow.topology import TopologicalState

STEP = 0.1  # seconds from one frame to the next; a step of all dynamics
FREE = -1  # the index of the grasped link where none is grasped
ACTIONS_PER_CURVE = 4  # consecutive splines that move a random curve
MAX_CROSSINGS = 4  # a rope with more is replaced by another curve
RANDOM_SHARE = 0.25  # of random splines among those that move random curves


@dataclass(frozen=True, eq=False)
class Motions:
    """Ropes dragged by a gripper and let go; metres, world frame, frames `STEP` apart."""

    points: NDArray[np.float32]  # (N, T, V, 3)
    gripper: NDArray[np.float32]  # (N, T, 3)
    grasped: NDArray[np.int64]  # (N, T) link that is held until the next frame, or `FREE`
    level: NDArray[np.int64]  # (N,) how far the rope may be from the planner's

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: NDArray | slice) -> Motions:
        return Motions(*(value[rows] for value in vars(self).values()))

    def save(self, path: Path) -> None:
        """Write an NPZ file."""
        np.savez(path, **vars(self))

    @classmethod
    def load(cls, path: Path) -> Motions:
        with np.load(path) as file:
            return cls(**file)

    @classmethod
    def join(cls, parts: Sequence[Motions]) -> Motions:
        """Motions of all parts; the last frames of shorter ones are repeated."""
        longest = max(part.grasped.shape[1] for part in parts)
        frames = {
            name: np.concatenate([repeat_last(getattr(part, name), longest) for part in parts])
            for name in ("points", "gripper", "grasped")
        }
        return cls(**frames, level=np.concatenate([part.level for part in parts]))


def draw_motions(
    demonstrations: Sequence[Demonstration],
    config: SimulationConfig,
    level: int,
    count: int,
    rng: np.random.Generator,
) -> Motions:
    """Motions of one perturbed rope; those that diverge are left out.

    Half begin where a demonstration does: a quarter with noisy copies of its spline, a quarter with
    one aimed at any action. The others move random curves by `ACTIONS_PER_CURVE` consecutive
    splines, aimed or random.
    """
    rope = perturb_rope(config.rope, level, rng)
    simulator = RopeSimulator(replace(config, rope=rope, record_rate=1 / config.timestep))
    raised = np.array([0.0, 0.0, rope.radius - config.rope.radius])
    starts, splines = [], []
    for number in range(count // 2):
        one = demonstrations[int(rng.integers(len(demonstrations)))]
        starts.append(one.points + raised)
        if number % 2:
            splines.append(heuristic_any_action(one.points, one.task.start_state, rng))
        else:
            splines.append(noisy_copies(one.spline, 1, rng, NoiseConfig())[0])
    parts = []
    if starts:
        parts.append(_execute(simulator, np.stack(starts), np.stack(splines), level)[0])
    remaining = count - len(starts)
    curves = -(-remaining // ACTIONS_PER_CURVE)
    points = [random_curve(config.rope, rng) + raised for _ in range(curves)]
    while remaining > 0:
        points = points[:remaining]
        remaining -= len(points)
        states = [TopologicalState.from_curve(one) for one in points]
        splines = [
            heuristic_any_action(one, state, rng, RANDOM_SHARE)
            for one, state in zip(points, states, strict=True)
        ]
        motions, ends = _execute(simulator, np.stack(points), np.stack(splines), level)
        parts.append(motions)
        points = [
            end - [*end[:, :2].mean(axis=0), 0.0]
            if (state := state_or_none(end)) is not None and state.num_crossings <= MAX_CROSSINGS
            else random_curve(config.rope, rng) + raised
            for end in ends
        ]
    return Motions.join(parts)


def _execute(
    simulator: RopeSimulator, points: NDArray, splines: NDArray, level: int
) -> tuple[Motions, NDArray[np.float64]]:
    """The motions that did not diverge, and the ends (B, V, 3) of all."""
    config = simulator.config
    rollouts = simulator.execute(points, splines)
    frames = np.arange(0, len(rollouts.times), round(STEP / config.timestep))
    held = rollouts.times[frames] < rollouts.release_times[:, None] - 1e-6
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
    """Indices of a simulator's frames that show ropes after so many time steps.

    Frames come a time step early (see `Rollouts.trajectory`) but for the first and the last.
    """
    return np.where(steps > 0, np.minimum(steps + 1, frames - 1), 0)
