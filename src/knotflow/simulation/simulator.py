"""Batched, threaded execution of splines on ropes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.simulation.rope import Floats, RopeConfig, build_model, check_points, pose
from knotflow.simulation.spline import check_splines, control_points, grasped_link, spline_path

MOST_STEPS = 100_000
"""Time steps of one spline."""
CHUNK = 64
"""Ropes simulated at once: enough for every thread, small enough to bound memory."""
PER_ROPE = ("trajectory", "gripper", "end_points", "diverged")
"""Fields of `Rollouts` with a row a rope."""


@dataclass
class SimulationConfig:
    """How a spline is executed."""

    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope and its table."""
    timestep: float = 0.01
    """Simulation time step, seconds."""
    contact_time: float = 0.02
    """Time constant of contacts and grasp, seconds; at least two time steps."""
    move_time: float = 1.8
    """Time from grasp to release, seconds."""
    ramp_time: float = 0.2
    """Time over which the gripper gains and loses its speed, seconds."""
    settle_time: float = 0.7
    """Time after release in which the rope comes to rest, seconds."""
    record_rate: float = 10.0
    """Frames of a trajectory per second."""
    threads: int = field(default=0, metadata={"affects_result": False})
    """Threads to simulate on; 0 takes OMP_NUM_THREADS, or else every CPU."""

    def __post_init__(self) -> None:
        for name in ("timestep", "contact_time", "move_time", "ramp_time", "record_rate"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("settle_time", "threads"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be 0 or more, got {getattr(self, name)}")
        if self.ramp_time > self.move_time / 2:
            raise ValueError(
                f"ramp_time is half of move_time at most, got {self.ramp_time} of {self.move_time}"
            )
        steps = (self.move_time + self.settle_time) / self.timestep
        if not 1 <= steps <= MOST_STEPS:
            raise ValueError(
                f"a spline takes 1 to {MOST_STEPS} time steps; {self.move_time} s and "
                f"{self.settle_time} s to settle take {steps:.3g} of {self.timestep} s"
            )


@dataclass(frozen=True)
class Rollouts:
    """The simulation of a batch of ropes; metres and seconds, world frame."""

    times: Floats
    """(T,) time of each frame; the first is 0, before the grasp."""
    trajectory: NDArray[np.float32]
    """(B, T, V, 3) rope vertices; after the first frame, those of a time step before its time."""
    gripper: NDArray[np.float32]
    """(B, T, 3) gripper positions."""
    end_points: Floats
    """(B, V, 3) rope vertices of the last frame, at rest; the start's where it diverged."""
    diverged: NDArray[np.bool_]
    """(B,) whether the simulation blew up."""

    def __len__(self) -> int:
        return len(self.end_points)

    @classmethod
    def concatenate(cls, parts: Sequence[Rollouts]) -> Rollouts:
        """Batches of one simulator as one."""
        arrays = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in PER_ROPE
        }
        return replace(parts[0], **arrays)

    def __getitem__(self, rows: slice | NDArray[Any] | list[int]) -> Rollouts:
        """Some of the ropes, as a slice, a mask (B,) or indices select them."""
        return replace(self, **{name: getattr(self, name)[rows] for name in PER_ROPE})


class RopeSimulator:
    """Executes splines on ropes at rest, on threads of its own; not to be called concurrently."""

    def __init__(self, config: SimulationConfig) -> None:
        from mujoco.batch import Batch  # here, so that the configuration is read without it

        self.config = config
        self.model = build_model(config.rope, config.timestep, config.contact_time)
        self._vertex_sites = np.array(
            [self.model.site(f"vertex_{i}").id for i in range(config.rope.num_vertices)]
        )
        self._moving = round(config.move_time / config.timestep)
        self._steps = self._moving + round(config.settle_time / config.timestep)
        stride = max(1, round(1 / config.record_rate / config.timestep))
        # Frames count steps back from the end, so that the last one is the rope at rest.
        self._frames = np.unique(np.r_[0, np.arange(self._steps, 0, -stride)])
        self._batch = Batch(self.model, CHUNK, config.threads or _default_threads())

    def execute(self, points: ArrayLike, splines: ArrayLike) -> Rollouts:
        """Simulate each spline (B, 6) on its rope (B, V, 3), metres, world frame, rest to rest.

        Raises:
            ShapeError: points that are not shapes of this rope.
            SplineError: splines out of range.
        """
        rope = self.config.rope
        points, splines = check_points(points, rope), check_splines(splines)
        if points.ndim != 3 or splines.shape != (len(points), 6):
            raise ValueError(
                f"execute() takes points (B, V, 3) and splines (B, 6), got {points.shape} and "
                f"{splines.shape}"
            )
        link = grasped_link(splines, rope.links)
        gripper = self._gripper_path(control_points(points, splines, rope.radius))
        parts = [
            self._execute(points[rows], gripper[rows], link[rows])
            for rows in np.array_split(np.arange(len(points)), -(-len(points) // CHUNK) or 1)
        ]
        vertices = np.concatenate([part[0] for part in parts])
        diverged = np.concatenate([part[1] for part in parts])
        end_points = vertices[:, -1].astype(np.float64)
        end_points[diverged] = points[diverged]
        frames = self._frames
        return Rollouts(
            times=frames * self.config.timestep,
            trajectory=np.concatenate([points[:, None], vertices], 1).astype(np.float32),
            gripper=gripper[:, np.maximum(frames - 1, 0)].astype(np.float32),
            end_points=end_points,
            diverged=diverged,
        )

    def _execute(
        self, points: Floats, gripper: Floats, link: NDArray[np.intp]
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Vertices (B, T - 1, V, 3) at the frames after the first, and divergence (B,)."""
        import mujoco

        count, links = len(points), self.config.rope.links
        if count == 0:
            return np.zeros((0, len(self._frames) - 1, links + 1, 3)), np.zeros(0, bool)
        control = np.zeros((count, self._steps, links + 3))
        control[np.arange(count), : self._moving, link] = 1.0
        control[:, :, links:] = gripper
        batch, ids = self._batch, np.arange(count)
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        batch.qpos[:count] = pose(points, self.config.rope)
        recorded = batch.rollout(
            self._steps,
            control,
            int(mujoco.mjtState.mjSTATE_EQ_ACTIVE | mujoco.mjtState.mjSTATE_MOCAP_POS),
            record=["site_xpos"],
            ids=ids,
        )["site_xpos"].reshape(count, self._steps, -1, 3)
        vertices = recorded[:, self._frames[1:, None] - 1, self._vertex_sites]
        # A simulation that blows up stops and counts a warning; `status` stays 0.
        warned = np.asarray(batch.warning)[:count, :, 1].any(axis=1)
        diverged = warned | ~np.isfinite(vertices).all(axis=(1, 2, 3))
        return vertices, diverged

    def _gripper_path(self, controls: Floats) -> Floats:
        """Gripper positions (B, steps, 3) along splines with control points (B, 3, 3)."""
        ramp = self.config.ramp_time / self.config.move_time
        time = np.minimum(np.arange(1, self._steps + 1) / self._moving, 1.0)
        return spline_path(controls, _progress(time, ramp))


def _progress(time: Floats, ramp: float) -> Floats:
    """Fraction of the path at each fraction of the time, with constant speed between ramps."""
    speed = 1 / (1 - ramp)
    up = speed * time**2 / (2 * ramp)
    down = 1 - speed * (1 - time) ** 2 / (2 * ramp)
    return np.where(time < ramp, up, np.where(time > 1 - ramp, down, speed * (time - ramp / 2)))


def _default_threads() -> int:
    granted = os.environ.get("OMP_NUM_THREADS", "")
    return int(granted) if granted.isdigit() and int(granted) else os.cpu_count() or 1
