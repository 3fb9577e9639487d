"""Executions judged by the truth: which ways to execute there are, and why one fails."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotflow.execution.dynamics import ModelPrediction, MujocoDynamics
from knotflow.execution.execute import Execution, Replan, execute
from knotflow.execution.follow import Controller, ExecutionConfig
from knotflow.execution.robot import Robot
from knotflow.execution.sight import Estimated, Look, RopeSource, Tracked
from knotflow.execution.training_config import SHIPPED_DYNAMICS
from knotflow.execution.twin import TrueState, Twin
from knotflow.perception import Camera, Network
from knotflow.planning import Goal, KnotPlan
from knotflow.simulation import SimulationConfig, state_or_none


@dataclass(frozen=True)
class Control:
    """One way to execute a plan."""

    state: str = ""
    """Where the rope's state comes from: true, vision, or from nowhere."""
    tracks: bool = False
    """Whether MPPI corrects the drag."""
    replans: bool = False
    """Whether it is planned anew after each action."""
    model: str = "lstm"
    """What MPPI predicts by: lstm, which is learned, or mujoco, the planner's simulator."""
    robust: bool = False
    """Whether the plan was judged by an ensemble of ropes, see `planning.ensemble`."""


CONTROLS = {
    "open_loop": Control(),
    "open_loop_robust": Control(robust=True),
    "mppi": Control("vision", tracks=True),
    "replan": Control("vision", replans=True),
    "mppi_replan": Control("vision", tracks=True, replans=True),
    "replan_true_state": Control("true", replans=True),
    "mppi_true_state": Control("true", tracks=True),
    "mppi_true_state_mujoco": Control("true", tracks=True, model="mujoco"),
    "mppi_replan_true_state": Control("true", tracks=True, replans=True),
}
"""By the names that tables give them."""


@dataclass(frozen=True)
class Trial:
    """An execution, and what is true of it.

    Attributes:
        execution: what was done and seen.
        tied: whether the rope truly lies in a state of the goal.
        cause: why not, in two or three words; empty where it is tied.
        deviation: mean distance of the rope's vertices from the plan's while it was dragged,
            metres; NaN where it never was.
    """

    execution: Execution
    tied: bool
    cause: str
    deviation: float


def try_plan(
    plan: KnotPlan,
    goal: Goal,
    twin: Twin,
    control: Control,
    config: ExecutionConfig | None = None,
    replan: Replan | None = None,
    camera: Camera | None = None,
    weights: Path = SHIPPED_DYNAMICS,
    network: Network | None = None,
    robot: Robot | None = None,
) -> Trial:
    """Execute a plan on a twin, which is then used up.

    Args:
        plan: for the goal, from the rope as the twin was laid down.
        goal: what is tied.
        twin: with a camera if the control sees by one.
        control: one of `CONTROLS`.
        config: heights, speeds, and when to give up.
        replan: used if the control replans.
        camera: the twin's, as it is believed to stand.
        weights: file of the learned dynamics.
        network: proposes first guesses at the rope in an image.
        robot: the twin's, or one that passes on to it, such as one of `FAULTS`.
    """
    simulator = SimulationConfig(rope=twin.config.rope, threads=1)
    source: RopeSource | None = None
    look: Look | None = None
    controller: Controller | None = None
    if control.state == "true":
        source = look = TrueState(twin)
    elif control.state == "vision":
        assert camera is not None
        from knotflow.perception import Tracker

        prediction = ModelPrediction(MujocoDynamics(simulator))
        tracker = Tracker(camera, simulator.rope, plan.start, predict=prediction, network=network)
        source = Tracked(tracker)
        look = Estimated(camera, simulator.rope, network=network, tracker=tracker)
    if control.tracks:
        from knotflow.execution.lstm import LstmDynamics
        from knotflow.execution.mppi import Mppi

        mujoco = control.model == "mujoco"
        controller = Mppi(MujocoDynamics(simulator) if mujoco else LstmDynamics.load(weights))
    replan = replan if control.replans else None
    execution = execute(plan, robot or twin.robot(), config, source, controller, look, replan)
    away = np.linalg.norm(
        execution.reference - np.reshape(twin.trajectory, execution.reference.shape), axis=-1
    )
    dragged = away[np.isfinite(away).all(axis=1)]
    return Trial(
        execution,
        tied=state_or_none(twin.points) in goal.states,
        cause=failure(execution, goal, twin),
        deviation=float(dragged.mean()) if len(dragged) else float("nan"),
    )


def failure(execution: Execution, goal: Goal, twin: Twin) -> str:
    """Why a knot is not tied: the first that applies of the causes below; empty where it is."""
    truth, sight = state_or_none(twin.points), execution.sight
    if truth in goal.states:
        return ""
    if sight is not None and sight.points is None:
        return "rope not seen"
    if sight is not None and sight.state != truth:
        return "state misread"
    if sight is not None and sight.doubts:
        return "state in doubt"
    if any(not one.followed for one in execution.outcomes[-1:]):
        return "track lost"
    if twin.missed if sight is None else any(not one.held for one in execution.outcomes[-1:]):
        return "grasp missed"
    if truth is None or truth not in goal.dag:
        return "out of the DAG"
    return "action failed"
