from .arm import Arm, ArmError, Base, load_arm
from .dynamics import MujocoDynamics, RopeDynamics, Still
from .errors import STEPS, predict_motions, prediction_errors
from .execute import (
    Controller,
    Estimator,
    Execution,
    ExecutionConfig,
    RopeSource,
    Seen,
    execute,
)
from .export import Export, export_plan
from .franka import panda
from .lstm import LstmConfig, LstmDynamics
from .mppi import Mppi, MppiConfig
from .perturbation import ERRORS, EXPONENTS, LEVELS, Errors, perturb_rope
from .reach import Reached, follow_waypoints
from .robot import Robot
from .rope_motions import FREE, STEP, Motions, draw_motions
from .timing import JointTrajectory, time_joints
from .training import DynamicsTraining, DynamicsTrainingConfig
from .twin import TrueState, Twin, TwinConfig

__all__ = [
    "ERRORS",
    "EXPONENTS",
    "FREE",
    "LEVELS",
    "STEP",
    "STEPS",
    "Arm",
    "ArmError",
    "Base",
    "Controller",
    "DynamicsTraining",
    "DynamicsTrainingConfig",
    "Errors",
    "Estimator",
    "Execution",
    "ExecutionConfig",
    "Export",
    "JointTrajectory",
    "LstmConfig",
    "LstmDynamics",
    "Motions",
    "Mppi",
    "MppiConfig",
    "MujocoDynamics",
    "Reached",
    "Robot",
    "RopeDynamics",
    "RopeSource",
    "Seen",
    "Still",
    "TrueState",
    "Twin",
    "TwinConfig",
    "draw_motions",
    "execute",
    "export_plan",
    "follow_waypoints",
    "load_arm",
    "panda",
    "perturb_rope",
    "predict_motions",
    "prediction_errors",
    "time_joints",
]
