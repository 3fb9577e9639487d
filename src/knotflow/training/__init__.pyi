from .config import (
    ExplorationConfig,
    ImitationConfig,
    LearnerConfig,
    ReinforcementConfig,
    SelfPlayConfig,
)
from .imitation import Imitation
from .learner import Learner
from .losses import ActorLoss, CriticLoss
from .reinforcement import Reinforcement, Round
from .self_play import SelfPlay, SelfPlayRound
from .transitions import Transitions

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
    "SelfPlay",
    "SelfPlayConfig",
    "SelfPlayRound",
    "Transitions",
]
