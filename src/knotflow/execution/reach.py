"""Inverse kinematics along a plan's waypoints with mink (differential, a QP a step).

The tip's position comes first, then the gripper's direction: pointing down, its fingers closing
across the strand it grasps. Where it comes down and closes it must; once it holds the rope it may
turn about the vertical, as the rope does that it drags. At the edge of the workspace the gripper
tilts rather than miss.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.arm import PREFIX, TABLE, Arm, Base
from knotflow.planning import KnotPlan, Waypoints
from knotflow.simulation import grasped_link

if TYPE_CHECKING:
    import mink

TOLERANCE = 1e-3
"""Distance of the tip from its waypoint that counts as reached, metres."""
MAX_TILT = np.deg2rad(30.0)
"""The gripper may lean this far from pointing down."""
MAX_TURN = np.deg2rad(15.0)
"""The fingers may close this far from across the strand."""
GRASPING = ("descend", "close")
"""Phases in which the fingers must close across the strand,"""
BOUND = ("travel", *GRASPING)
"""and those in which they turn there and keep; in the others the gripper may turn."""
CLEARANCE = 1e-3
"""Least distance between arm and table, and between links that are not neighbours, metres."""

# Weights of a metre missed and of a radian tilted, turned or away from home. The last settles what
# the tip leaves free; much smaller ones get lost in the solver's tolerance.
_MISS_COST, _TILT_COST, _TURN_COST, _HOME_COST = 200.0, 2.0, 4.0, 0.05
_LOOSE_TURN_COST = 0.1  # of a gripper that holds the rope or leaves it
_HOMING = 0.1  # share of the way home an iteration; a faster one would keep the arm moving
_LONGEST_STEP = 0.15  # rad (m) an iteration; near a stretched arm longer ones leap about
_LARGEST_MOVE = 0.2  # rad (m) a waypoint; more would take the tip off its path in between
_CLOSE_ENOUGH, _SETTLED = 1e-4, 2e-3  # metres, radians an iteration
_ITERATIONS = 25
_TRIES = 12


@dataclass(frozen=True, eq=False)
class Reached:
    """An arm following N waypoints as closely as it can.

    Attributes:
        joints: (N, n) configurations, radians (metres for slides).
        positions: (N, 3) of the tip by forward kinematics, metres, world frame.
        quaternions: (N, 4) of the tip, w x y z.
        error: (N,) distance from the waypoints, metres.
        tilt: (N,) of the gripper from pointing down, radians.
        turn: (N,) of the fingers from the direction in which they should close, radians; 0 where
            they do not come down on a strand or close on it.
    """

    joints: NDArray[np.float64]
    positions: NDArray[np.float64]
    quaternions: NDArray[np.float64]
    error: NDArray[np.float64]
    tilt: NDArray[np.float64]
    turn: NDArray[np.float64]

    @property
    def ok(self) -> NDArray[np.bool_]:
        """(N,) whether each waypoint is reached."""
        return (self.error <= TOLERANCE) & (self.tilt <= MAX_TILT) & (self.turn <= MAX_TURN)


def follow_waypoints(
    plan: KnotPlan, waypoints: Waypoints, arm: Arm, base: Base | None = None
) -> Reached:
    """Follow a plan's waypoints with an arm, within its joint ranges and above the table.

    For each step the fingers can close in two directions, half a turn apart. The one nearer to
    the arm's home is taken, or the other where that reaches more waypoints.
    """
    solver = _Solver(arm, base or arm.base)
    joints: NDArray | None = None
    yaw: float | None = None
    parts: list[_Part] = []
    phases = np.array(waypoints.phases)
    for step, plan_step in enumerate(plan.steps):
        rows = np.flatnonzero(waypoints.step == step)
        bound = np.isin(phases[rows], BOUND)
        link = int(grasped_link(plan_step.spline, len(plan_step.start) - 1))
        x, y, _ = plan_step.start[link + 1] - plan_step.start[link]
        nearer = solver.nearest_yaw(float(np.arctan2(y, x)), waypoints.positions[rows[-1]])
        best: _Part | None = None
        for goal in (nearer, nearer + np.pi):
            yaws = _yaws(yaw, goal, phases[rows] == "travel")
            part = solver.follow(joints, waypoints.positions[rows], yaws, bound)
            if best is None or part.missed < best.missed:
                best = part
            if not best.missed:
                break
        assert best is not None
        parts.append(best)
        joints, yaw = best.joints[-1], solver.yaw(best.joints[-1], near=float(best.yaws[-1]))
    return solver.reached(parts, waypoints)


@dataclass(frozen=True, eq=False)
class _Part:
    """One step: joints (n, J), the yaws (n,) asked for, and how many waypoints were missed."""

    joints: NDArray[np.float64]
    yaws: NDArray[np.float64]
    missed: int


def _yaws(begin: float | None, end: float, travel: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Direction (n,) of the gripper's x axis: it turns while it travels, then keeps."""
    if begin is None:
        return np.full(len(travel), end)
    u = np.minimum(np.cumsum(travel) / max(travel.sum(), 1), 1.0)
    return begin + u**2 * (3.0 - 2.0 * u) * (end - begin)


class _Solver:
    """An arm's kinematics and the QP that follows a tip."""

    def __init__(self, arm: Arm, base: Base) -> None:
        import mink

        self.arm, self.base = arm, base
        self.model = arm.model(base)
        self.configuration = mink.Configuration(self.model)
        names = [PREFIX + name for name in arm.joints]
        self.columns = np.array([self.model.jnt_qposadr[self.model.joint(n).id] for n in names])
        self.site = self.model.site(PREFIX + arm.tip).id
        turning = [_TILT_COST, _TILT_COST, _TURN_COST]
        self.tip = mink.FrameTask(PREFIX + arm.tip, "site", _MISS_COST, turning)
        self.rest = self._home()
        self.posture = mink.PostureTask(self.model, _HOME_COST, gain=_HOMING)
        self.ranges = mink.ConfigurationLimit(self.model)
        self.low, self.high = self.ranges.lower.copy(), self.ranges.upper.copy()
        self.limits = [
            self.ranges,
            mink.VelocityLimit(self.model, dict.fromkeys(names, _LONGEST_STEP)),
            self._no_collision(),
        ]
        self.configuration.update(self.rest)
        x, y, _ = self._rotation()[:, 0]
        self.home_azimuth = self._azimuth(self._position())
        self.home_yaw = float(np.arctan2(y, x)) - self.home_azimuth
        # About the vertical, upward (+1) or downward (-1)? Then the first joint faces the work.
        self.swing = float(np.round(self.configuration.data.xaxis[self._first_joint()][2]))

    def nearest_yaw(self, strand: float, place: NDArray) -> float:
        """The direction along a strand, of two, that lies nearer to the gripper's at home."""
        home = self.home_yaw + self._azimuth(place)
        return home + (strand - home + np.pi / 2) % np.pi - np.pi / 2

    def follow(
        self, start: NDArray | None, positions: NDArray, yaws: NDArray, bound: NDArray[np.bool_]
    ) -> _Part:
        """Track positions (n, 3), and yaws (n,) where they bind, from joints (J,) or anywhere."""
        if start is None:
            start = self._find(positions[0], yaws[0])
        self._place(start)
        joints, missed = [], 0
        for position, yaw, binds in zip(positions, yaws, bound, strict=True):
            here = self.configuration.q
            self.ranges.lower = np.maximum(self.low, here - _LARGEST_MOVE)
            self.ranges.upper = np.minimum(self.high, here + _LARGEST_MOVE)
            missed += not self._go(position, yaw, binds)
            joints.append(self.configuration.q[self.columns])
        self.ranges.lower, self.ranges.upper = self.low, self.high
        return _Part(np.array(joints), yaws, missed)

    def yaw(self, joints: NDArray, near: float) -> float:
        """Direction of the gripper's x axis at joints (J,), within half a turn of `near`."""
        self._place(joints)
        x, y, _ = self._rotation()[:, 0]
        return near + (float(np.arctan2(y, x)) - near + np.pi) % (2 * np.pi) - np.pi

    def reached(self, parts: list[_Part], waypoints: Waypoints) -> Reached:
        """What forward kinematics says of the joints found."""
        import mujoco

        joints = np.concatenate([part.joints for part in parts])
        yaws = np.concatenate([part.yaws for part in parts])
        positions, quaternions, off = [], [], []
        for joint, yaw in zip(joints, yaws, strict=True):
            self._place(joint)
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, self._rotation().ravel())
            positions.append(self._position())
            quaternions.append(quaternion)
            off.append(self._off(yaw))
        tilt, turn = np.array(off).T
        turn[~np.isin(waypoints.phases, GRASPING)] = 0.0
        error = np.linalg.norm(np.array(positions) - waypoints.positions, axis=1)
        return Reached(joints, np.array(positions), np.array(quaternions), error, tilt, turn)

    def _find(self, position: NDArray, yaw: float) -> NDArray[np.float64]:
        """Joints (J,) for the first waypoint: from home, else from elsewhere in the ranges."""
        rng = np.random.default_rng(0)
        low = np.maximum(self.low[self.columns], -np.pi)
        high = np.minimum(self.high[self.columns], np.pi)
        best, least = self.rest[self.columns], np.inf
        for start in self._starts(position, rng, low, high):
            self._place(np.clip(start, low, high))
            done = self._go(position, yaw, iterations=8 * _ITERATIONS)
            error = float(np.linalg.norm(self._position() - position))
            if error < least:
                best, least = self.configuration.q[self.columns].copy(), error
            if done:
                break
        return best

    def _starts(
        self, position: NDArray, rng: np.random.Generator, low: NDArray, high: NDArray
    ) -> Iterator[NDArray[np.float64]]:
        home = self._rest_towards(position)[self.columns]
        yield home
        for _ in range(_TRIES):
            yield home + 0.3 * (rng.uniform(low, high) - home)

    def _go(
        self,
        position: NDArray,
        yaw: float,
        binds: bool = True,
        iterations: int = _ITERATIONS,
    ) -> bool:
        """Move the configuration to a waypoint; whether it is reached."""
        import mink

        turn_cost = _TURN_COST if binds else _LOOSE_TURN_COST
        self.tip.set_orientation_cost([_TILT_COST, _TILT_COST, turn_cost])
        self.tip.set_target(mink.SE3.from_rotation_and_translation(_down(yaw), position))
        self.posture.set_target(self._rest_towards(position))
        tilt, turn, missed = *self._off(yaw), np.inf
        for _ in range(iterations):
            try:
                step = mink.solve_ik(
                    self.configuration,
                    [self.tip, self.posture],
                    1.0,
                    "daqp",
                    damping=1e-5,
                    limits=self.limits,
                )
            except mink.NoSolutionFound:
                break
            self.configuration.integrate_inplace(step, 1.0)
            before, (tilt, turn) = tilt + turn, self._off(yaw)
            nearer, missed = missed, float(np.linalg.norm(self._position() - position))
            there = missed < _CLOSE_ENOUGH or abs(missed - nearer) < 0.1 * _CLOSE_ENOUGH
            if there and abs(tilt + turn - before) < _SETTLED:
                break
        return bool(missed <= TOLERANCE and tilt <= MAX_TILT and (turn <= MAX_TURN or not binds))

    def _place(self, joints: NDArray) -> None:
        """Put the arm at joints (J,)."""
        q = self.rest.copy()
        q[self.columns] = joints
        self.configuration.update(q)

    def _off(self, yaw: float) -> tuple[float, float]:
        """How far the gripper leans from pointing down, and its fingers from closing across."""
        rotation = self._rotation()
        tilt = np.arccos(np.clip(-rotation[2, 2], -1.0, 1.0))
        across = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        turn = np.arccos(np.clip(rotation[:, 1] @ across / _level(rotation[:, 1]), -1.0, 1.0))
        return float(tilt), float(turn)

    def _no_collision(self) -> mink.CollisionAvoidanceLimit:
        """Table and arm, and the links with each other, but for those that touch at home."""
        import mink
        import mujoco

        table = self.model.geom(TABLE).id
        parts = [
            geom
            for geom in range(self.model.ngeom)
            if geom != table and self.model.geom_contype[geom] | self.model.geom_conaffinity[geom]
        ]
        self.configuration.update(self.rest)
        data, apart = self.configuration.data, []
        for a in parts:
            moves = self.model.body_weldid[self.model.geom_bodyid[a]] != 0
            apart += [([a], [table])] if moves else []
            apart += [
                ([a], [b])
                for b in parts
                if b > a
                and mujoco.mj_geomDistance(self.model, data, a, b, 1.0, None) > 2 * CLEARANCE
            ]
        return mink.CollisionAvoidanceLimit(
            self.model,
            apart,
            minimum_distance_from_collisions=CLEARANCE,
            collision_detection_distance=0.05,
        )

    def _home(self) -> NDArray[np.float64]:
        """The whole model's configuration at the home in which the gripper points down most."""
        best, lowest = self.model.qpos0.copy(), np.inf
        for home in self.arm.homes:
            q = self.model.qpos0.copy()
            q[self.columns] = home
            self.configuration.update(q)
            if self._rotation()[2, 2] < lowest:
                best, lowest = q, self._rotation()[2, 2]
        return best

    def _rest_towards(self, place: NDArray) -> NDArray[np.float64]:
        """Home, turned by the first joint to face a place."""
        turn = self._azimuth(place) - self.home_azimuth
        rest = self.rest.copy()
        rest[self.columns[0]] += self.swing * ((turn + np.pi) % (2 * np.pi) - np.pi)
        return np.clip(rest, self.low, self.high)

    def _first_joint(self) -> int:
        return int(self.model.joint(PREFIX + self.arm.joints[0]).id)

    def _azimuth(self, place: NDArray) -> float:
        x, y = np.asarray(place)[:2] - np.asarray(self.base.position)[:2]
        return float(np.arctan2(y, x))

    def _position(self) -> NDArray[np.float64]:
        return np.array(self.configuration.data.site_xpos[self.site])

    def _rotation(self) -> NDArray[np.float64]:
        return np.array(self.configuration.data.site_xmat[self.site]).reshape(3, 3)


def _down(yaw: float) -> mink.SO3:
    """A gripper that points down, its x axis in direction `yaw`, its fingers closing across."""
    import mink

    c, s = np.cos(yaw), np.sin(yaw)
    return mink.SO3.from_matrix(np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]))


def _level(vector: NDArray) -> float:
    """Length of a vector's level part, not 0."""
    return max(float(np.hypot(vector[0], vector[1])), 1e-9)
