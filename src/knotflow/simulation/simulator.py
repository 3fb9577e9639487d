"""Batched, threaded execution of splines on ropes."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.arrays import repeat_last
from knotflow.simulation.rope import RopeConfig, adapt_model, build_model, check_points, pose
from knotflow.simulation.spline import (
    along_path,
    check_splines,
    control_points,
    grasped_link,
    polyline,
)
from knotflow.simulation.worlds import World
from knotflow.threads import cpus
from knotflow.topology.polyline import Floats

SLOTS = 64
"""Ropes simulated at once: enough for every thread, small enough to bound memory."""
CHECK_TIME = 0.1
"""Seconds between two looks whether a rope is at rest."""
PER_ROPE = ("trajectory", "gripper", "frames", "release_times", "end_points", "diverged")
"""Fields of `Rollouts` with a row a rope."""
OF_ROPE = (
    *("body_mass", "body_inertia", "body_subtreemass", "body_invweight0", "geom_size"),
    *("geom_friction", "geom_rbound", "geom_aabb", "bvh_aabb", "jnt_stiffness"),
    *("dof_damping", "dof_armature", "dof_M0", "dof_invweight0", "dof_length"),
)
"""Fields of `MjModel` that differ from rope to rope of one length and number of links."""


@dataclass
class SimulationConfig:
    """How a spline is executed."""

    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope and its table."""
    timestep: float = 0.02
    """Simulation time step, seconds."""
    contact_time: float = 0.04
    """Time constant of contacts and grasp, seconds; at least two time steps."""
    pace: float = 0.25
    """Speed of the gripper along the spline, metres per second."""
    ramp_time: float = 0.2
    """Time over which the gripper gains and loses its pace, seconds."""
    rest_speed: float = 0.01
    """The rope is at rest when no vertex is faster than this, metres per second."""
    settle_time: float = 1.0
    """Longest time after release in which the rope comes to rest, seconds."""
    record_rate: float = 10.0
    """Frames of a trajectory per second. Whether a rope is at rest is looked at with a frame, so a
    rate that does not divide 10 moves ends by a millimetre or two."""
    threads: int = field(default=0, metadata={"affects_result": False})
    """Threads to simulate on; 0 takes OMP_NUM_THREADS, or else every CPU."""

    def __post_init__(self) -> None:
        for name in ("timestep", "contact_time", "pace", "ramp_time", "record_rate"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("rest_speed", "settle_time", "threads"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be 0 or more, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class Motion:
    """A row of `Rollouts` of T frames."""

    times: Floats  # (T,)
    trajectory: NDArray[np.float32]  # (T, V, 3)
    gripper: NDArray[np.float32]  # (T, 3)
    release_time: float


@dataclass(frozen=True)
class Rollouts:
    """The simulation of a batch of ropes; metres and seconds, world frame."""

    times: Floats
    """(T,) time of each frame; the first is 0, before the grasp."""
    trajectory: NDArray[np.float32]
    """(B, T, V, 3) rope vertices; after the first frame, those of a time step before its time."""
    gripper: NDArray[np.float32]
    """(B, T, 3) gripper positions."""
    frames: NDArray[np.int64]
    """(B,) frames until a rope is at rest; the later ones repeat it."""
    release_times: Floats
    """(B,) seconds from grasp to release."""
    end_points: Floats
    """(B, V, 3) rope vertices of the last frame, at rest; the start's where it diverged."""
    diverged: NDArray[np.bool_]
    """(B,) whether the simulation blew up."""

    def __len__(self) -> int:
        return len(self.end_points)

    @classmethod
    def concatenate(cls, parts: Sequence[Rollouts]) -> Rollouts:
        """Batches of one simulator as one."""
        longest: Floats = max((part.times for part in parts), key=len)
        arrays = {}
        for name in PER_ROPE:
            rows = [getattr(part, name) for part in parts]
            if name in ("trajectory", "gripper"):
                rows = [repeat_last(one, len(longest)) for one in rows]
            arrays[name] = np.concatenate(rows)
        return cls(times=longest, **arrays)

    @classmethod
    def between(cls, points: Floats, ends: Floats) -> Rollouts:
        """Rollouts of which only the first and the last shape (B, V, 3) are known."""
        count = len(points)
        return cls(
            times=np.array([0.0, 1.0]),
            trajectory=np.stack([points, ends], axis=1).astype(np.float32),
            gripper=np.full((count, 2, 3), np.nan, np.float32),
            frames=np.full(count, 2),
            release_times=np.full(count, np.nan),
            end_points=ends,
            diverged=np.zeros(count, bool),
        )

    def motion(self, row: int) -> Motion:
        """The frames of one rope, without the repeated ones."""
        frames = int(self.frames[row])
        return Motion(
            self.times[:frames],
            self.trajectory[row, :frames].copy(),
            self.gripper[row, :frames].copy(),
            float(self.release_times[row]),
        )

    def __getitem__(self, rows: slice | NDArray[Any] | list[int]) -> Rollouts:
        return replace(self, **{name: getattr(self, name)[rows] for name in PER_ROPE})


class RopeSimulator:
    """Executes splines on ropes at rest, on threads of its own; not to be called concurrently."""

    def __init__(self, config: SimulationConfig) -> None:
        import mujoco  # here, so that the configuration is read without it
        from mujoco.batch import Batch

        if mujoco.get_mju_user_warning() is None:  # which would write ./MUJOCO_LOG.TXT
            mujoco.set_mju_user_warning(logging.getLogger(__name__).debug)
        self.config = config
        self.model = build_model(config.rope, config.timestep, config.contact_time)
        self._vertex_sites = np.array(
            [self.model.site(f"vertex_{i}").id for i in range(config.rope.num_vertices)]
        )
        self._stride = max(1, round(1 / config.record_rate / config.timestep))
        frames = max(1, round(CHECK_TIME / config.timestep / self._stride))
        self._segment = self._stride * frames
        self._batch = Batch(self.model, SLOTS, config.threads or _default_threads())
        self._rest_angles = self._batch.expand("qpos_spring") if config.rope.keeps_bends else None
        self._ropes: dict[str, NDArray[Any]] = {}  # of each slot, once there are several

    def execute(
        self,
        points: ArrayLike,
        splines: ArrayLike,
        worlds: Sequence[World] | None = None,
        controls: Floats | None = None,
    ) -> Rollouts:
        """Simulate splines (B, 6) on ropes (B, V, 3), metres, in B `worlds` or the nominal one.

        In worlds, control points (B, 3, 3) that were planned for other shapes are followed blindly.

        Raises:
            ShapeError: points that are not shapes of this rope.
            SplineError: splines out of range.
            ValueError: another number of worlds, or a world of a rope of other length or links.
        """
        rope = self.config.rope
        points, splines = check_points(points, rope), check_splines(splines)
        if points.ndim != 3 or splines.shape != (len(points), 6):
            raise ValueError(
                f"execute() takes points (B, V, 3) and splines (B, 6), got {points.shape} and "
                f"{splines.shape}"
            )
        for world in worlds or ():
            if (world.rope.length, world.rope.links) != (rope.length, rope.links):
                raise ValueError(
                    f"a world's rope is {world.rope.length:g} m in {world.rope.links} links, but "
                    f"the simulator's {rope.length:g} m in {rope.links}"
                )
        if worlds is not None and len(worlds) != len(points):
            raise ValueError(f"{len(points)} splines need as many worlds, got {len(worlds)}")
        blind = controls is not None
        if controls is None:
            controls = control_points(points, splines, rope.radius)
        links = grasped_link(splines, rope.links)
        if worlds is not None and not self._ropes:
            self._ropes = {name: self._batch.expand(name) for name in OF_ROPE}
        each = [None] * len(points) if worlds is None else worlds
        columns = zip(points, controls, links, each, strict=True)
        moves = [self._move(*one, blind) for one in columns]
        self._run(moves)
        frames = np.array([len(move.frames) for move in moves], dtype=np.int64)
        last = int(frames.max(initial=1))
        count, stride = len(moves), self._stride
        trajectory = np.empty((count, last, rope.num_vertices, 3), np.float32)
        for row, move in zip(trajectory, moves, strict=True):
            row[: len(move.frames)] = move.frames
            row[len(move.frames) :] = move.frames[-1]
        step = np.maximum(np.arange(last) * stride - 1, 0)
        gripper = [move.gripper[np.minimum(step, len(move.gripper) - 1)] for move in moves]
        return Rollouts(
            times=stride * self.config.timestep * np.arange(last, dtype=np.float64),
            trajectory=trajectory,
            gripper=np.array(gripper, np.float32).reshape(count, last, 3),
            frames=frames,
            release_times=np.array([len(m.gripper) for m in moves]) * self.config.timestep,
            end_points=np.array(
                [m.start if m.diverged else m.frames[-1] for m in moves], np.float64
            ).reshape(points.shape),
            diverged=np.array([move.diverged for move in moves], dtype=bool),
        )

    def _move(
        self, start: Floats, controls: Floats, link: int | None, world: World | None, blind: bool
    ) -> Move:
        if world is None:
            return Move(start, controls, link, self.config)
        config = replace(self.config, rope=world.rope, pace=self.config.pace * world.pace)
        if blind or any(world.grasp) or any(world.shift):
            link, controls = world.disturb(start, controls)
        return Move(start, controls, link, config)

    def _run(self, moves: Sequence[Move]) -> None:
        """Simulate moves; a slot of the batch takes the next one as soon as its rope rests."""
        import mujoco

        links, batch = self.config.rope.links, self._batch
        control = int(mujoco.mjtState.mjSTATE_EQ_ACTIVE | mujoco.mjtState.mjSTATE_MOCAP_POS)
        # Long moves first, so that the last ones end together.
        waiting = sorted(range(len(moves)), key=lambda i: len(moves[i].gripper))
        poses = pose(np.array([move.start for move in moves]), self.config.rope) if moves else ()
        slots: dict[int, Move] = {}
        while waiting or slots:
            free = [slot for slot in range(SLOTS) if slot not in slots][: len(waiting)]
            if free:
                batch.reset(ids=free, stage=mujoco.mjtStage.mjSTAGE_NONE)
                for slot in free:
                    index = waiting.pop()
                    slots[slot] = moves[index]
                    batch.qpos[slot] = poses[index]
                    if self._rest_angles is not None:
                        self._rest_angles[slot] = poses[index]
                    if self._ropes:
                        rope = moves[index].config.rope
                        model = adapt_model(self.model, self.config.rope, rope)
                        for name, rows in self._ropes.items():
                            rows[slot] = getattr(model, name)
            ids = sorted(slots)
            inputs = np.zeros((len(ids), self._segment, links + 3))
            for row, slot in zip(inputs, ids, strict=True):
                slots[slot].control(row)
            recorded = batch.rollout(self._segment, inputs, control, record=["site_xpos"], ids=ids)[
                "site_xpos"
            ].reshape(len(ids), self._segment, -1, 3)
            # A simulation that blows up stops and counts a warning; `status` stays 0.
            warned: NDArray[np.bool_] = np.any(np.asarray(batch.warning)[ids, :, 1], axis=-1)
            vertices = recorded[:, self._stride - 1 :: self._stride][:, :, self._vertex_sites]
            for slot, shapes, blown_up in zip(ids, vertices, warned, strict=True):
                if slots[slot].advance(shapes, bool(blown_up), self._segment):
                    del slots[slot]


class Move:
    """A rope on its way along a spline."""

    def __init__(
        self, start: Floats, controls: Floats, link: int | None, config: SimulationConfig
    ) -> None:
        """A rope (V, 3) at rest, whose `link`, if any, follows control points (3, 3)."""
        self.start, self.link, self.config = start, link, config
        self.gripper = gripper_path(controls, config)
        self.frames = [start]
        self.diverged = False
        self.step = 0

    def control(self, out: Floats) -> None:
        """Write inputs (steps, links + 3): grasps, then the gripper."""
        steps = np.arange(self.step, self.step + len(out))
        if self.link is not None:
            out[steps < len(self.gripper), self.link] = 1.0
        out[:, -3:] = self.gripper[np.minimum(steps, len(self.gripper) - 1)]

    def advance(self, shapes: Floats, blown_up: bool, steps: int) -> bool:
        """Add frames (F, V, 3), the last of them after `steps`; returns whether it is over."""
        self.diverged = blown_up or not np.isfinite(shapes).all()
        if self.diverged:
            return True
        travelled = float(np.linalg.norm(shapes[-1] - self.frames[-1], axis=-1).max())
        self.frames.extend(shapes)
        self.step += steps
        still = travelled < self.config.rest_speed * steps * self.config.timestep
        settled = (self.step - len(self.gripper)) * self.config.timestep
        return settled >= self.config.settle_time or (still and settled >= CHECK_TIME)


def gripper_path(controls: Floats, config: SimulationConfig) -> Floats:
    """Gripper positions (steps, 3) at each time step of a move along control points (3, 3).

    The pace is constant but for ramps at either end.
    """
    path = polyline(controls)
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    ramp = config.ramp_time
    duration = length / config.pace + ramp
    if length < config.pace * ramp:  # never at full pace
        ramp = max(float(np.sqrt(length * ramp / config.pace)), 1e-6)
        duration = 2 * ramp
    steps = max(2, int(np.ceil(duration / config.timestep - 1e-9)))
    time = np.arange(1, steps + 1) / steps
    ramp /= duration
    speed = 1 / (1 - ramp)
    up = speed * time**2 / (2 * ramp)
    down = 1 - speed * (1 - time) ** 2 / (2 * ramp)
    even = speed * (time - ramp / 2)
    return along_path(path, np.where(time < ramp, up, np.where(time > 1 - ramp, down, even)))


def _default_threads() -> int:
    granted = os.environ.get("OMP_NUM_THREADS", "")
    return int(granted) if granted.isdigit() and int(granted) else cpus()
