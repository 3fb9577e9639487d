from .config import (
    ExplorationConfig,
    ImitationConfig,
    JointConfig,
    LearnerConfig,
    ReinforcementConfig,
)
from .imitation import Imitation
from .joint import JointFinetuning, JointRound, parse_path
from .learner import Learner
from .losses import ActorLoss, CriticLoss
from .reinforcement import Reinforcement, Round
from .transitions import Transitions

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
