from .arm.arm_model import Arm, ArmError, Base, load_arm, panda
from .arm.export import Export, export_plan
from .control.closed_loop import Execution, execute
from .control.dynamics import (
    SHIPPED_DYNAMICS,
    DynamicsTrainingConfig,
    LstmConfig,
    ModelPrediction,
    MujocoDynamics,
    StaticDynamics,
    motion_errors,
    prediction_errors,
)
from .control.dynamics_training import DynamicsTrainer
from .control.film import (
    DragFrame,
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
from .control.observation import ImageStateEstimator, Observation, StateEstimator, TrackedRope
from .control.robot import FAULTS, Robot
from .control.step_executor import ExecutionConfig
from .control.trial import CONTROLLERS, failure_cause, run_trial
from .control.twin import ERROR_LEVELS, TrueState, Twin, TwinConfig

__all__ = [
    "CONTROLLERS",
    "ERROR_LEVELS",
    "FAULTS",
    "FREE",
    "SHIPPED_DYNAMICS",
    "STEP",
    "Arm",
    "ArmError",
    "Base",
    "DragFrame",
    "DynamicsTrainer",
    "DynamicsTrainingConfig",
    "Execution",
    "ExecutionConfig",
    "Export",
    "ImageRecorder",
    "ImageStateEstimator",
    "LstmConfig",
    "LstmDynamics",
    "ModelPrediction",
    "Motions",
    "Mppi",
    "MppiConfig",
    "MujocoDynamics",
    "Observation",
    "Robot",
    "StateEstimator",
    "StaticDynamics",
    "TrackedRope",
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
    "load_arm",
    "motion_errors",
    "panda",
    "prediction_errors",
    "run_trial",
]
