"""Executions judged by the truth: which ways to execute there are, and why one fails."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotflow.execution.control.closed_loop import Execution, Replan, execute
from knotflow.execution.control.dynamics import SHIPPED_DYNAMICS, ModelPrediction, MujocoDynamics
from knotflow.execution.control.observation import (
    ImageStateEstimator,
    RopeSource,
    StateEstimator,
    TrackedRope,
)
from knotflow.execution.control.robot import Robot
from knotflow.execution.control.step_executor import Controller, ExecutionConfig
from knotflow.execution.control.twin import TrueState, Twin
from knotflow.perception import Camera, Network
from knotflow.planning import Goal, KnotPlan
from knotflow.simulation import SimulationConfig, state_or_none


@dataclass(frozen=True)
class ControllerSpec:
    """One way to execute a plan."""

    state: str = ""
    """Source of the rope's state: true, vision, or none."""
    tracks: bool = False
    """Whether MPPI corrects the drag."""
    replans: bool = False
    """Whether it is replanned after each action."""
    model: str = "lstm"
    """What MPPI predicts by: lstm, which is learned, or mujoco, the planner's simulator."""


CONTROLLERS = {
    "open_loop": ControllerSpec(),
    "mppi": ControllerSpec("vision", tracks=True),
    "replan": ControllerSpec("vision", replans=True),
    "mppi_replan": ControllerSpec("vision", tracks=True, replans=True),
    "replan_true_state": ControllerSpec("true", replans=True),
    "mppi_true_state": ControllerSpec("true", tracks=True),
    "mppi_true_state_mujoco": ControllerSpec("true", tracks=True, model="mujoco"),
    "mppi_replan_true_state": ControllerSpec("true", tracks=True, replans=True),
}
"""By the names that tables give them."""


@dataclass(frozen=True)
class Trial:
    """An execution judged by the truth.

    Attributes:
        execution: what was done and observed.
        tied: whether the rope truly lies in a goal state.
        cause: why not, see `failure_cause`; empty where it is tied.
        deviation: mean distance of the dragged rope's vertices from the plan's, metres, or NaN.
    """

    execution: Execution
    tied: bool
    cause: str
    deviation: float


def run_trial(
    plan: KnotPlan,
    goal: Goal,
    twin: Twin,
    spec: ControllerSpec,
    config: ExecutionConfig | None = None,
    replan: Replan | None = None,
    camera: Camera | None = None,
    weights: Path = SHIPPED_DYNAMICS,
    network: Network | None = None,
    robot: Robot | None = None,
) -> Trial:
    """Execute a plan on a twin, which is then used up.

    Args:
        plan: for the goal, from the twin's first rope.
        goal: what is tied.
        twin: with a camera if the state comes from vision.
        spec: one of `CONTROLLERS`.
        config: heights, speeds, and when to give up.
        replan: used if the controller replans.
        camera: the twin's, at its nominal pose.
        weights: file of the learned dynamics.
        network: proposes first guesses at the rope in an image.
        robot: the twin's, or a wrapper of it, such as one of `FAULTS`.
    """
    simulation = SimulationConfig(rope=twin.config.rope, threads=1)
    source: RopeSource | None = None
    estimator: StateEstimator | None = None
    controller: Controller | None = None
    if spec.state == "true":
        source = estimator = TrueState(twin)
    elif spec.state == "vision":
        assert camera is not None
        from knotflow.perception import Tracker

        prediction = ModelPrediction(MujocoDynamics(simulation))
        tracker = Tracker(camera, simulation.rope, plan.start, predict=prediction, network=network)
        source = TrackedRope(tracker)
        estimator = ImageStateEstimator(camera, simulation.rope, network=network, tracker=tracker)
    if spec.tracks:
        from knotflow.execution.control.lstm_dynamics import LstmDynamics
        from knotflow.execution.control.mppi import Mppi

        mujoco = spec.model == "mujoco"
        controller = Mppi(MujocoDynamics(simulation) if mujoco else LstmDynamics.load(weights))
    execution = execute(
        plan,
        robot or twin.robot(),
        config,
        source,
        controller,
        estimator,
        replan if spec.replans else None,
    )
    truth = np.reshape(twin.trajectory, execution.reference.shape)
    away = np.linalg.norm(execution.reference - truth, axis=-1)
    dragged = away[np.isfinite(away).all(axis=1)]
    return Trial(
        execution,
        tied=state_or_none(twin.points) in goal.states,
        cause=failure_cause(execution, goal, twin),
        deviation=float(dragged.mean()) if len(dragged) else float("nan"),
    )


def failure_cause(execution: Execution, goal: Goal, twin: Twin) -> str:
    """Why a knot is not tied: the first of these causes that applies; empty where it is tied."""
    truth, seen = state_or_none(twin.points), execution.observation
    lost = any(not one.held for one in execution.outcomes[-1:])
    if truth in goal.states:
        return ""
    if seen is not None and seen.points is None:
        return "rope not seen"
    if seen is not None and seen.state != truth:
        return "state misread"
    if seen is not None and seen.doubts:
        return "state in doubt"
    if any(not one.tracked for one in execution.outcomes[-1:]):
        return "track lost"
    if lost if seen is not None else twin.missed_grasps:
        return "grasp missed"
    if truth is None or truth not in goal.dag:
        return "out of the DAG"
    return "action failed"
