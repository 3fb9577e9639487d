"""The splines that an arm can follow: quickly of many, and exactly of a plan.

The filter follows splines as `inverse_kinematics` does, but many at once, on few points, from home
and without collisions.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from knotflow.execution.arm.export import LOWEST, Export, export_plan
from knotflow.execution.arm.inverse_kinematics import (
    FREE_TURN_COST,
    HOME_COST,
    HOME_GAIN,
    MAX_ITERATION_STEP,
    MAX_TILT,
    MAX_TURN,
    POSITION_COST,
    TILT_COST,
    TURN_COST,
    Solver,
)
from knotflow.execution.arm.model import PREFIX, Arm, Base, find_arm
from knotflow.execution.twin import Twin, TwinConfig
from knotflow.planning import Frame, GripperConfig, KnotPlan, Placement
from knotflow.simulation import (
    GRASP_REACH,
    SimulationConfig,
    control_points,
    grasped_link,
    spline_path,
    state_or_none,
)
from knotflow.topology.polyline import Floats

MOST_SLOWED = 2.0
"""Factor on the duration of a drag that is accepted: half the pace, as in the slowest `World`."""
POINTS = 12  # on a drag
TOLERANCE = 2e-3  # metres
FIRST_ITERATIONS, ITERATIONS = 60, 8
ACTIVE_SETS = 3  # of joints at the ends of their ranges, tried in an iteration


class ArmReach:
    """A `planning.Reach`: an arm and what it follows at `max_speed` of the tip, m/s."""

    def __init__(
        self,
        arm: str | Path | Arm = "panda",
        base: Path | Base | None = None,
        tip: str | None = None,
        *,
        simulation: SimulationConfig,
        placement: Placement | None = None,
        frame: Frame | None = None,
        max_speed: float = 0.25,
    ) -> None:
        """For a search in `simulation`; for arm, base and tip see `export_plan`.

        `placement` and `frame` lead from the searched rope to the measured one, whose frame `base`
        is in.
        """
        self.arm = find_arm(arm, tip)
        self.base = Base.load(base) if isinstance(base, str | Path) else base
        self._simulation, self._placement = simulation, placement or Placement()
        self._frame = frame or Frame()
        self._max_speed = max_speed
        stands = self.base.seen_from(self._frame) if self.base else self.arm.base
        self._solver, self._chain = Solver(self.arm, stands), Chain(self.arm, stands)

    def first_failed(self, plan: KnotPlan) -> int | None:
        """See `Reach`; by the exact inverse kinematics and `first_untied`."""
        placed = plan.placed(self._placement, self._frame)
        export = export_plan(placed, self.arm, self.base, self._max_speed)
        first = export.first_unreached(MOST_SLOWED)
        if first is None:
            first = first_untied(plan, export, self._simulation, self._placement, self._frame)
        return first

    def may_follow(self, points: Floats, splines: Floats) -> NDArray[np.bool_]:
        """See `Reach`; either way that the fingers can close across the strand."""
        controls = self._placement.points(
            control_points(points, splines, self._simulation.rope.radius)
        )
        path = spline_path(controls, np.linspace(0.0, 1.0, POINTS))  # (N, POINTS, 3)
        path[..., 2] += np.maximum(LOWEST - path[..., 2].min(axis=1, keepdims=True), 0.0)
        link = grasped_link(splines, len(points) - 1)
        x, y, _ = (points[link + 1] - points[link]).T
        yaws = np.array(
            [
                self._solver.nearest_yaw(float(strand), end)
                for strand, end in zip(np.arctan2(y, x), path[:, -1], strict=True)
            ]
        )
        radius = self._placement.length * self._simulation.rope.radius
        heights = GripperConfig().clear_of(self._placement.points(points), radius)
        yaws = np.concatenate([yaws, yaws + np.pi])
        both = self._follow(np.tile(path, (2, 1, 1)), yaws, heights)
        return np.asarray(both.reshape(2, -1).any(axis=0))

    def _follow(self, paths: Floats, yaws: Floats, heights: GripperConfig) -> NDArray[np.bool_]:
        """Whether the arm comes down on, follows and leaves paths (B, P, 3), at full pace."""
        solver, chain = self._solver, self._chain
        above, up = paths[:, 0].copy(), paths[:, -1].copy()
        above[:, 2], up[:, 2] = heights.approach_height, heights.retreat_height
        home = np.array([solver.home_towards(one)[solver.columns] for one in above])
        chain.home = home
        start = chain.solve(home, above, yaws, TURN_COST, FIRST_ITERATIONS)
        ok = chain.reached(start, above, yaws)
        joints = chain.solve(start, (above + paths[:, 0]) / 2, yaws, TURN_COST, ITERATIONS)
        joints = chain.solve(joints, paths[:, 0], yaws, TURN_COST, ITERATIONS)
        ok &= chain.reached(joints, paths[:, 0], yaws)
        for before, here in itertools.pairwise(paths.swapaxes(0, 1)):
            moved = chain.solve(joints, here, yaws, FREE_TURN_COST, ITERATIONS)
            seconds = np.linalg.norm(here - before, axis=1, keepdims=True) / self._max_speed
            allowed = MOST_SLOWED * seconds * self.arm.max_speed
            ok &= (np.abs(moved - joints) <= allowed + 1e-3).all(axis=1)
            ok &= chain.reached(moved, here)
            joints = moved
        joints = chain.solve(joints, (paths[:, -1] + up) / 2, yaws, FREE_TURN_COST, ITERATIONS)
        joints = chain.solve(joints, up, yaws, FREE_TURN_COST, ITERATIONS)
        return ok & chain.reached(joints, up)


def first_untied(
    plan: KnotPlan,
    export: Export,
    simulation: SimulationConfig,
    placement: Placement | None = None,
    frame: Frame | None = None,
) -> int | None:
    """The first step after which the rope is not in the planned state; None where it is tied.

    On a `Twin` of the planner's rope, with its time step, whose tip moves as exported, in place and
    time. `placement` and `frame` lead from the plan to the export.
    """
    placement, frame = placement or Placement(), frame or Frame()
    catches = GRASP_REACH / placement.length
    config = TwinConfig(0, simulation.rope, simulation.timestep, simulation.contact_time, catches)
    twin = Twin(plan.start, config, np.random.default_rng(0))
    positions = frame.from_file(export.ik.positions) - [placement.x, placement.y, 0.0]
    seconds = np.diff(export.times, prepend=export.times[0]) / placement.times(1.0)
    waypoints = export.waypoints
    moves = zip(positions / placement.length, seconds, waypoints.phases, strict=True)
    before, first = "", None
    for number, (position, duration, phase) in zip(waypoints.step, moves, strict=True):
        if phase == "drag" != before:
            done = plan.steps[number - 1].end_state if number else plan.start_state
            if first is None and state_or_none(twin.points) != done:
                first = max(int(number) - 1, 0)
            twin.grasp()
        elif before == "drag" != phase:
            twin.release()
        twin.move_to(position, float(duration))
        before = phase
    if state_or_none(twin.points) in plan.goal_states:
        return None
    return len(plan.steps) - 1 if first is None else first


class Chain:
    """Kinematics of many configurations (B, n) at once, by the product of exponentials."""

    def __init__(self, arm: Arm, base: Base) -> None:
        import mujoco

        model = arm.model(base)
        data, ids = mujoco.MjData(model), arm.joint_ids(model)
        data.qpos[model.jnt_qposadr[ids]] = 0.0
        mujoco.mj_kinematics(model, data)
        self.axes, self.anchors = data.xaxis[ids].copy(), data.xanchor[ids].copy()
        self.slides = model.jnt_type[ids] == mujoco.mjtJoint.mjJNT_SLIDE
        tip = data.site(PREFIX + arm.tip)
        self.tip, self.turn = tip.xpos.copy(), tip.xmat.reshape(3, 3).copy()
        free = ~model.jnt_limited[ids].astype(bool)[:, None]
        self.low, self.high = np.where(free, [-np.inf, np.inf], model.jnt_range[ids]).T
        self.home = np.zeros((1, len(ids)))

    def tips(self, joints: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions (B, 3) and rotations (B, 3, 3) of the tip, and Jacobians (B, 6, n)."""
        count, size = joints.shape
        turn, place = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        axes, anchors = np.empty((count, size, 3)), np.empty((count, size, 3))
        for i, slides in enumerate(self.slides):
            axes[:, i] = turn @ self.axes[i]
            anchors[:, i] = turn @ self.anchors[i] + place
            if slides:
                place = place + axes[:, i] * joints[:, i, None]
                continue
            turn = turn @ Rotation.from_rotvec(self.axes[i] * joints[:, i, None]).as_matrix()
            place = anchors[:, i] - turn @ self.anchors[i]
        tip = turn @ self.tip + place
        slides = self.slides[:, None]
        moved = np.where(slides, axes, np.cross(axes, tip[:, None] - anchors))
        jacobian = np.concatenate([moved, np.where(slides, 0.0, axes)], axis=2)
        return tip, turn @ self.turn, jacobian.swapaxes(1, 2)

    def solve(
        self, joints: Floats, positions: Floats, yaws: Floats, turn_cost: float, iterations: int
    ) -> Floats:
        """Joints (B, n) nearer to tips at (B, 3) that point down, x axes at yaws (B,)."""
        costs = np.array([POSITION_COST] * 3 + [TILT_COST] * 2 + [turn_cost])
        wanted = Rotation.from_euler("z", yaws[:, None]).as_matrix() * [1.0, -1.0, -1.0]
        identity = np.eye(joints.shape[1])
        for _ in range(iterations):
            tip, rotation, jacobian = self.tips(joints)
            back = rotation.swapaxes(1, 2)
            turn = Rotation.from_matrix(back @ wanted).as_rotvec()
            error = np.concatenate([positions - tip, turn], axis=1) * costs
            jacobian = np.concatenate([jacobian[:, :3], back @ jacobian[:, 3:]], axis=1)
            jacobian *= costs[:, None]
            transposed = jacobian.swapaxes(1, 2)
            matrix = transposed @ jacobian + (HOME_COST**2 + 1e-5) * identity
            vector = (transposed @ error[..., None])[..., 0]
            vector += HOME_COST**2 * HOME_GAIN * (self.home - joints)
            step = np.linalg.solve(matrix, vector[..., None])[..., 0]
            largest = np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-9)
            share = np.minimum(1.0, MAX_ITERATION_STEP / largest)
            step, vector = share * step, share * vector
            low, high = self.low - joints, self.high - joints
            held = np.zeros(step.shape, bool)  # at the end of their range
            for _ in range(ACTIVE_SETS):
                beyond = (step < low - 1e-9) | (step > high + 1e-9)
                if not beyond.any():
                    break
                held |= beyond
                fixed = np.where(held, np.clip(step, low, high), 0.0)
                rest = np.where(held, fixed, vector - (matrix @ fixed[..., None])[..., 0])
                either = held[:, :, None] | held[:, None]
                free = np.where(either, identity * held[:, None], matrix)
                step = np.linalg.solve(free, rest[..., None])[..., 0]
            joints = np.clip(joints + step, self.low, self.high)
        return joints

    def reached(
        self, joints: Floats, positions: Floats, yaws: Floats | None = None
    ) -> NDArray[np.bool_]:
        """Whether tips (B,) are there, point down, and where yaws are given, are turned so."""
        tip, rotation, _ = self.tips(joints)
        ok = np.linalg.norm(tip - positions, axis=1) <= TOLERANCE
        ok &= -rotation[:, 2, 2] >= np.cos(MAX_TILT)
        if yaws is not None:
            off = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]) - yaws
            ok &= np.cos(off) >= np.cos(MAX_TURN)
        return np.asarray(ok)
