"""Inverse kinematics along a plan's waypoints with mink (differential, a QP a step).

The tip's position comes before the gripper's direction: pointing down, and while it grasps, its
fingers closing across the strand. At the edge of the workspace the gripper tilts rather than miss.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.arm.model import PREFIX, TABLE, Arm, Base
from knotflow.planning import Waypoints

if TYPE_CHECKING:
    import mink

TOLERANCE = 1e-3  # of a reached waypoint, metres
MAX_TILT = np.deg2rad(30.0)  # of the gripper from pointing down
MAX_TURN = np.deg2rad(15.0)  # of the closing fingers from across the strand
GRASPING = ("descend", "close")  # phases in which the fingers must close across the strand
ALIGNED = ("travel", *GRASPING)  # in which the gripper may not turn freely about the vertical
CLEARANCE = 1e-3  # of arm and table, and of links that are not neighbours, metres

# Costs of a metre missed and of a radian tilted, turned or away from home.
POSITION_COST, TILT_COST, TURN_COST, HOME_COST = 200.0, 2.0, 4.0, 0.05
FREE_TURN_COST = 0.1  # of a gripper that holds the rope or leaves it
HOME_GAIN = 0.1  # share of the way home an iteration
MAX_ITERATION_STEP = 0.15  # rad (m)
MAX_WAYPOINT_STEP = 0.2  # rad (m)
CONVERGED_POSITION, CONVERGED_ANGLE = 1e-4, 2e-3  # metres, radians an iteration
ITERATIONS = 25
RESTARTS = 12


@dataclass(frozen=True, eq=False)
class IkSolution:
    """An arm following N waypoints as closely as it can; world frame, metres, radians."""

    joints: NDArray[np.float64]  # (N, n)
    positions: NDArray[np.float64]  # (N, 3) of the tip by forward kinematics
    quaternions: NDArray[np.float64]  # (N, 4) of the tip, w x y z
    error: NDArray[np.float64]  # (N,) distance from the waypoints
    tilt: NDArray[np.float64]  # (N,) of the gripper from pointing down
    turn: NDArray[np.float64]  # (N,) of the grasping fingers from across the strand; else 0

    @property
    def ok(self) -> NDArray[np.bool_]:
        """(N,) whether each waypoint is reached."""
        return (self.error <= TOLERANCE) & (self.tilt <= MAX_TILT) & (self.turn <= MAX_TURN)


def follow_waypoints(waypoints: Waypoints, arm: Arm, base: Base | None = None) -> IkSolution:
    """Follow a plan's waypoints with an arm, within its joint ranges and above the table.

    Of each step's two grasps, half a turn apart, the one nearer to the arm's home is taken, or the
    other where that reaches more waypoints.
    """
    solver, phases = Solver(arm, base or arm.base), np.array(waypoints.phases)
    joints: NDArray | None = None
    yaw: float | None = None
    segments: list[_Segment] = []
    for step in np.unique(waypoints.step):
        rows = np.flatnonzero(waypoints.step == step)
        positions, aligned = waypoints.positions[rows], np.isin(phases[rows], ALIGNED)
        nearer = solver.nearest_yaw(float(waypoints.yaws[rows[0]]), positions[-1])
        found: list[_Segment] = []
        for goal in (nearer, nearer + np.pi):
            yaws = _interpolate_yaw(yaw, goal, phases[rows] == "travel")
            found.append(solver.follow(joints, positions, yaws, aligned))
            if not found[-1].missed:
                break
        best = min(found, key=lambda segment: segment.missed)
        segments.append(best)
        joints, yaw = best.joints[-1], solver.yaw(best.joints[-1], near=float(best.yaws[-1]))
    return solver.solution(segments, waypoints)


class _Segment(NamedTuple):
    """One step of a plan: n waypoints."""

    joints: NDArray[np.float64]  # (n, J)
    yaws: NDArray[np.float64]  # (n,) desired
    missed: int


def _interpolate_yaw(
    begin: float | None, end: float, travel: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Direction (n,) of the gripper's x axis: it turns while it travels, then keeps."""
    if begin is None:
        return np.full(len(travel), end)
    u = np.minimum(np.cumsum(travel) / max(travel.sum(), 1), 1.0)
    return begin + u**2 * (3.0 - 2.0 * u) * (end - begin)


class Solver:
    """An arm's kinematics and the QP that moves its tip."""

    def __init__(self, arm: Arm, base: Base) -> None:
        import mujoco

        try:
            import mink
        except ModuleNotFoundError as error:
            raise ImportError(f"arms need {error.name}: pip install 'knotflow[arm]'") from error
        self.base, self.model = base, arm.model(base)
        self.configuration = mink.Configuration(self.model)
        ids = arm.joint_ids(self.model)
        self.columns = self.model.jnt_qposadr[ids]
        self.site = self.model.site(PREFIX + arm.tip).id
        turn_costs = [TILT_COST, TILT_COST, TURN_COST]
        self.tip_task = mink.FrameTask(self.site, "site", POSITION_COST, turn_costs)
        self.posture_task = mink.PostureTask(self.model, HOME_COST, gain=HOME_GAIN)
        self.home = self._lowest_home(arm)
        self.ranges = mink.ConfigurationLimit(self.model)
        self.low, self.high = self.ranges.lower.copy(), self.ranges.upper.copy()
        speeds = dict.fromkeys((PREFIX + name for name in arm.joints), MAX_ITERATION_STEP)
        self.configuration.update(self.home)
        velocities = mink.VelocityLimit(self.model, speeds)
        self.limits = [self.ranges, velocities, self._collision_limit()]
        position, rotation = self._tip()
        x, y, _ = rotation[:, 0]
        self.home_azimuth = self._azimuth(position)
        # About the vertical, upward (+1) or downward (-1)? Then the first joint faces the work.
        turns = self.model.jnt_type[ids[0]] == mujoco.mjtJoint.mjJNT_HINGE
        vertical = self.configuration.data.xaxis[ids[0]][2] * (1.0 + 1e-6)
        self.swing = float(np.trunc(vertical)) if turns else 0.0
        self.home_yaw = float(np.arctan2(y, x)) - abs(self.swing) * self.home_azimuth

    def nearest_yaw(self, strand: float, position: NDArray) -> float:
        """Of the two directions along a strand, the nearer to the gripper's at home."""
        home = self.home_yaw + abs(self.swing) * self._azimuth(position)
        return home + (strand - home + np.pi / 2) % np.pi - np.pi / 2

    def follow(
        self, start: NDArray | None, positions: NDArray, yaws: NDArray, aligned: NDArray[np.bool_]
    ) -> _Segment:
        """Track positions (n, 3), and yaws (n,) where `aligned`, from joints (J,) or anywhere."""
        self._set_joints(self._find_start(positions[0], yaws[0]) if start is None else start)
        joints, missed = [], 0
        for position, yaw, align in zip(positions, yaws, aligned, strict=True):
            here = self.configuration.q
            self.ranges.lower = np.maximum(self.low, here - MAX_WAYPOINT_STEP)
            self.ranges.upper = np.minimum(self.high, here + MAX_WAYPOINT_STEP)
            missed += not self._solve(position, yaw, align)
            joints.append(self.configuration.q[self.columns])
        self.ranges.lower, self.ranges.upper = self.low, self.high
        return _Segment(np.array(joints), yaws, missed)

    def yaw(self, joints: NDArray, near: float) -> float:
        """Direction of the gripper's x axis at joints (J,), within half a turn of `near`."""
        self._set_joints(joints)
        x, y, _ = self._tip()[1][:, 0]
        return near + (float(np.arctan2(y, x)) - near + np.pi) % (2 * np.pi) - np.pi

    def tip(self, joints: NDArray) -> NDArray[np.float64]:
        """Position (3,) of the tip at joints (J,), metres."""
        self._set_joints(joints)
        return self._tip()[0].copy()

    def solution(self, segments: list[_Segment], waypoints: Waypoints) -> IkSolution:
        """Tip poses and errors by forward kinematics."""
        joints = np.concatenate([segment.joints for segment in segments])
        yaws = np.concatenate([segment.yaws for segment in segments])
        poses, angles = [], []
        for configuration, yaw in zip(joints, yaws, strict=True):
            self._set_joints(configuration)
            poses.append(self.configuration.get_transform_frame_to_world(self.site, "site"))
            angles.append(self._tilt_and_turn(yaw))
        tilt, turn = np.array(angles).T
        turn[~np.isin(waypoints.phases, GRASPING)] = 0.0
        positions = np.array([pose.translation() for pose in poses])
        quaternions = np.array([pose.rotation().wxyz for pose in poses])
        error = np.linalg.norm(positions - waypoints.positions, axis=1)
        return IkSolution(joints, positions, quaternions, error, tilt, turn)

    def _find_start(self, position: NDArray, yaw: float) -> NDArray[np.float64]:
        """Joints (J,) for the first waypoint: from home, else from elsewhere in the ranges."""
        rng = np.random.default_rng(0)
        low = np.maximum(self.low[self.columns], -np.pi)
        high = np.minimum(self.high[self.columns], np.pi)
        home = self.home_towards(position)[self.columns]
        restarts = (home + 0.3 * (rng.uniform(low, high) - home) for _ in range(RESTARTS))
        best, least = home, np.inf
        for start in chain([home], restarts):
            self._set_joints(np.clip(start, low, high))
            reached = self._solve(position, yaw, iterations=8 * ITERATIONS)
            error = float(np.linalg.norm(self._tip()[0] - position))
            if error < least:
                best, least = self.configuration.q[self.columns], error
            if reached:
                break
        return best

    def _solve(
        self, position: NDArray, yaw: float, align: bool = True, iterations: int = ITERATIONS
    ) -> bool:
        """Move the configuration to a waypoint; whether it is reached."""
        import mink

        # Pointing down, its x axis in direction `yaw`, so that the fingers close across.
        down = mink.SO3.from_z_radians(yaw) @ mink.SO3.from_x_radians(np.pi)
        turn_cost = TURN_COST if align else FREE_TURN_COST
        self.tip_task.set_orientation_cost([TILT_COST, TILT_COST, turn_cost])
        self.tip_task.set_target(mink.SE3.from_rotation_and_translation(down, position))
        self.posture_task.set_target(self.home_towards(position))
        tilt, turn = self._tilt_and_turn(yaw)
        missed = np.inf
        for _ in range(iterations):
            try:
                tasks = [self.tip_task, self.posture_task]
                step = mink.solve_ik(
                    self.configuration, tasks, 1.0, "daqp", damping=1e-5, limits=self.limits
                )
            except mink.NoSolutionFound:
                break
            self.configuration.integrate_inplace(step, 1.0)
            before, (tilt, turn) = tilt + turn, self._tilt_and_turn(yaw)
            nearer, missed = missed, float(np.linalg.norm(self._tip()[0] - position))
            there = missed < CONVERGED_POSITION or abs(missed - nearer) < 0.1 * CONVERGED_POSITION
            if there and abs(tilt + turn - before) < CONVERGED_ANGLE:
                break
        return bool(missed <= TOLERANCE and tilt <= MAX_TILT and (turn <= MAX_TURN or not align))

    def _set_joints(self, joints: NDArray) -> None:
        q = self.home.copy()
        q[self.columns] = joints
        self.configuration.update(q)

    def _tip(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Position (3,) and rotation (3, 3) of the tip."""
        data = self.configuration.data
        return data.site_xpos[self.site], data.site_xmat[self.site].reshape(3, 3)

    def _tilt_and_turn(self, yaw: float) -> tuple[float, float]:
        """See `IkSolution`."""
        _, rotation = self._tip()
        fingers, across = rotation[:, 1], np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        level = max(float(np.hypot(*fingers[:2])), 1e-9)
        tilt = np.arccos(np.clip(-rotation[2, 2], -1.0, 1.0))
        turn = np.arccos(np.clip(fingers @ across / level, -1.0, 1.0))
        return float(tilt), float(turn)

    def _collision_limit(self) -> mink.CollisionAvoidanceLimit:
        """Table and arm, and the links with each other, but for those that touch at home."""
        import mink
        import mujoco

        model, data, table = self.model, self.configuration.data, self.model.geom(TABLE).id
        parts = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        parts = parts[parts != table].tolist()
        pairs = [([a], [table]) for a in parts]  # mink leaves out what cannot move
        pairs += [
            ([a], [b])
            for a, b in combinations(parts, 2)
            if mujoco.mj_geomDistance(model, data, a, b, 1.0, None) > 2 * CLEARANCE
        ]
        return mink.CollisionAvoidanceLimit(
            model, pairs, minimum_distance_from_collisions=CLEARANCE,
            collision_detection_distance=0.05,
        )  # fmt: skip

    def _lowest_home(self, arm: Arm) -> NDArray[np.float64]:
        """The whole model's configuration at the home in which the gripper points down most."""
        homes = np.repeat(self.model.qpos0[None], len(arm.homes), axis=0)
        homes[:, self.columns] = arm.homes

        def upward(home: NDArray[np.float64]) -> float:
            self.configuration.update(home)
            return float(self._tip()[1][2, 2])

        return min(homes, key=upward)

    def home_towards(self, position: NDArray) -> NDArray[np.float64]:
        """Home, turned by the first joint to face a position."""
        turn = self._azimuth(position) - self.home_azimuth
        home = self.home.copy()
        home[self.columns[0]] += self.swing * ((turn + np.pi) % (2 * np.pi) - np.pi)
        return np.clip(home, self.low, self.high)

    def _azimuth(self, position: NDArray) -> float:
        x, y = np.asarray(position)[:2] - np.asarray(self.base.position)[:2]
        return float(np.arctan2(y, x))
