from .arm import Arm, ArmError, Base, load_arm
from .dynamics import ModelPrediction, MujocoDynamics, RopeDynamics, Still
from .errors import STEPS, predict_motions, prediction_errors
from .execute import Execution, Replan, StepOutcome, execute
from .export import Export, export_plan
from .faults import FAULTS, Faulty
from .film import Filming, Frame, animate_execution, draw_execution, frames, jpeg
from .follow import Controller, ExecutionConfig, Tick
from .franka import panda
from .lstm import LstmDynamics
from .mppi import Mppi, MppiConfig
from .perturbation import ERRORS, Errors
from .reach import Reached, follow_waypoints
from .robot import Relay, Robot, Timed
from .rope_motions import FREE, STEP, Motions, draw_motions
from .sight import Estimated, Look, RopeSource, Sight, Tracked
from .timing import JointTrajectory, time_joints
from .training import DynamicsTraining
from .training_config import DynamicsTrainingConfig, LstmConfig
from .trial import CONTROLS, Control, Trial, failure, try_plan
from .twin import TrueState, Twin, TwinConfig

__all__ = [
    "CONTROLS",
    "ERRORS",
    "FAULTS",
    "FREE",
    "STEP",
    "STEPS",
    "Arm",
    "ArmError",
    "Base",
    "Control",
    "Controller",
    "DynamicsTraining",
    "DynamicsTrainingConfig",
    "Errors",
    "Estimated",
    "Execution",
    "ExecutionConfig",
    "Export",
    "Faulty",
    "Filming",
    "Frame",
    "JointTrajectory",
    "Look",
    "LstmConfig",
    "LstmDynamics",
    "ModelPrediction",
    "Motions",
    "Mppi",
    "MppiConfig",
    "MujocoDynamics",
    "Reached",
    "Relay",
    "Replan",
    "Robot",
    "RopeDynamics",
    "RopeSource",
    "Sight",
    "StepOutcome",
    "Still",
    "Tracked",
    "Trial",
    "Tick",
    "Timed",
    "TrueState",
    "Twin",
    "TwinConfig",
    "animate_execution",
    "draw_execution",
    "draw_motions",
    "execute",
    "export_plan",
    "failure",
    "follow_waypoints",
    "frames",
    "jpeg",
    "load_arm",
    "panda",
    "predict_motions",
    "prediction_errors",
    "time_joints",
    "try_plan",
]
