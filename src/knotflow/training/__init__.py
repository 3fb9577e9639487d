"""Training of the primitives (Sec. V-B a to c): imitation, reinforcement, joint finetuning.

It knows the simulator and what demonstrations are, but neither recordings nor stages: iterating
over a training gives what there is to log, to record and to save.
"""

from knotflow.training.exploration import ExplorationConfig
from knotflow.training.imitation import Imitation, ImitationConfig
from knotflow.training.joint import JointConfig, JointFinetuning, JointRound, parse_path
from knotflow.training.learner import Learner, LearnerConfig
from knotflow.training.losses import ActorLoss, CriticLoss
from knotflow.training.reinforcement import (
    Reinforcement,
    ReinforcementConfig,
    Round,
)
from knotflow.training.transitions import Transitions

__all__ = [
    "ActorLoss",
    "CriticLoss",
    "ExplorationConfig",
    "Imitation",
    "ImitationConfig",
    "JointConfig",
    "JointFinetuning",
    "JointRound",
    "Learner",
    "LearnerConfig",
    "Reinforcement",
    "ReinforcementConfig",
    "Round",
    "Transitions",
    "parse_path",
]
