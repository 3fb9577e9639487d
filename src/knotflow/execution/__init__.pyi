from .arm.export import Export, export_plan
from .arm.model import ARMS, Arm, ArmError, Base, find_arm, load_arm, panda, ur5e, xarm7
from .arm.reach import ArmReach, first_untied
from .closed_loop import CONTROLLERS, Execution, execute, failure_cause, run_trial
from .dynamics import (
    SHIPPED_DYNAMICS,
    DynamicsTrainingConfig,
    LstmConfig,
    ModelPrediction,
    MujocoDynamics,
    StaticDynamics,
    motion_errors,
    prediction_errors,
)
from .film import DragFrame, ImageRecorder, drag_frames, draw_execution, encode_jpeg, film_rollout
from .lstm_dynamics import DynamicsTrainer, LstmDynamics
from .motions import FREE, STEP, Motions, draw_motions
from .mppi import Mppi, MppiConfig
from .robot import FAULTS, ImageStateEstimator, Observation, Robot, StateEstimator, TrackedRope
from .step_executor import ExecutionConfig
from .twin import ERROR_LEVELS, TrueState, Twin, TwinConfig

__all__ = [
    "ARMS", "CONTROLLERS", "ERROR_LEVELS", "FAULTS", "FREE", "SHIPPED_DYNAMICS", "STEP", "Arm",
    "ArmError", "ArmReach", "Base", "DragFrame", "DynamicsTrainer", "DynamicsTrainingConfig",
    "Execution", "ExecutionConfig", "Export", "ImageRecorder", "ImageStateEstimator",
    "LstmConfig", "LstmDynamics", "ModelPrediction", "Motions", "Mppi", "MppiConfig",
    "MujocoDynamics", "Observation", "Robot", "StateEstimator", "StaticDynamics", "TrackedRope",
    "TrueState", "Twin", "TwinConfig", "drag_frames", "draw_execution", "draw_motions",
    "encode_jpeg", "execute", "export_plan", "failure_cause", "film_rollout", "find_arm",
    "first_untied", "load_arm", "motion_errors", "panda", "prediction_errors", "run_trial", "ur5e",
    "xarm7",
]  # fmt: skip
