"""Training of the primitives (Sec. V-B a, b): replay buffer, losses, imitation, reinforcement.

It knows the simulator and what demonstrations are, but neither recordings nor stages: iterating
over a training gives what there is to log, to record and to save.
"""

from knotflow.training.exploration import ExplorationConfig
from knotflow.training.imitation import Imitation, ImitationConfig
from knotflow.training.learner import Learner, LearnerConfig
from knotflow.training.losses import ActorLoss, CriticLoss
from knotflow.training.reinforcement import (
    Reinforcement,
    ReinforcementConfig,
    Round,
)

__all__ = [
    "ActorLoss",
    "CriticLoss",
    "ExplorationConfig",
    "Imitation",
    "ImitationConfig",
    "Learner",
    "LearnerConfig",
    "Reinforcement",
    "ReinforcementConfig",
    "Round",
]
