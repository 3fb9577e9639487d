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
from .lstm import LstmConfig, LstmDynamics
from .mppi import Mppi, MppiConfig
from .perturbation import ERRORS, EXPONENTS, LEVELS, Errors, perturb_rope
from .robot import Robot
from .rope_motions import FREE, STEP, Motions, draw_motions
from .training import DynamicsTraining, DynamicsTrainingConfig
from .twin import TrueState, Twin, TwinConfig

__all__ = [
    "ERRORS",
    "EXPONENTS",
    "FREE",
    "LEVELS",
    "STEP",
    "STEPS",
    "Controller",
    "DynamicsTraining",
    "DynamicsTrainingConfig",
    "Errors",
    "Estimator",
    "Execution",
    "ExecutionConfig",
    "LstmConfig",
    "LstmDynamics",
    "Motions",
    "Mppi",
    "MppiConfig",
    "MujocoDynamics",
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
    "perturb_rope",
    "predict_motions",
    "prediction_errors",
]
