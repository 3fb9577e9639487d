from .arm.arm_model import Arm, ArmError, Base, load_arm, panda
from .arm.export import Export, JointTrajectory, export_plan, time_joints
from .arm.inverse_kinematics import IkSolution, follow_waypoints
from .control.closed_loop import Execution, Replan, StepOutcome, execute
from .control.dynamics import (
    JUDGED_STEPS,
    SHIPPED_DYNAMICS,
    DynamicsTrainingConfig,
    LstmConfig,
    ModelPrediction,
    MujocoDynamics,
    RopeDynamics,
    StaticDynamics,
    motion_errors,
    prediction_errors,
)
from .control.dynamics_training import DynamicsTrainer
from .control.film import (
    DragFrame,
    FilmedRollout,
    ImageRecorder,
    animate_execution,
    drag_frames,
    draw_execution,
    encode_jpeg,
    film_rollout,
)
from .control.lstm_dynamics import LstmDynamics
from .control.motions import FREE, STEP, Motions, draw_motions
from .control.mppi import Mppi, MppiConfig
from .control.observation import (
    ImageStateEstimator,
    Observation,
    RopeSource,
    StateEstimator,
    TrackedRope,
)
from .control.robot import FAULTS, Robot, RobotWrapper
from .control.step_executor import Controller, ExecutionConfig, TickTiming
from .control.trial import CONTROLLERS, ControllerSpec, Trial, failure_cause, run_trial
from .control.twin import ERROR_LEVELS, ErrorLevel, TrueState, Twin, TwinConfig

__all__ = [
    "Arm",
    "ArmError",
    "Base",
    "CONTROLLERS",
    "Controller",
    "ControllerSpec",
    "DragFrame",
    "DynamicsTrainer",
    "DynamicsTrainingConfig",
    "ERROR_LEVELS",
    "ErrorLevel",
    "Execution",
    "ExecutionConfig",
    "Export",
    "FAULTS",
    "FREE",
    "FilmedRollout",
    "IkSolution",
    "ImageRecorder",
    "ImageStateEstimator",
    "JUDGED_STEPS",
    "JointTrajectory",
    "LstmConfig",
    "LstmDynamics",
    "ModelPrediction",
    "Motions",
    "Mppi",
    "MppiConfig",
    "MujocoDynamics",
    "Observation",
    "Replan",
    "Robot",
    "RobotWrapper",
    "RopeDynamics",
    "RopeSource",
    "SHIPPED_DYNAMICS",
    "STEP",
    "StateEstimator",
    "StaticDynamics",
    "StepOutcome",
    "TickTiming",
    "TrackedRope",
    "Trial",
    "TrueState",
    "Twin",
    "TwinConfig",
    "animate_execution",
    "drag_frames",
    "draw_execution",
    "draw_motions",
    "encode_jpeg",
    "execute",
    "export_plan",
    "failure_cause",
    "film_rollout",
    "follow_waypoints",
    "load_arm",
    "motion_errors",
    "panda",
    "prediction_errors",
    "run_trial",
    "time_joints",
]
