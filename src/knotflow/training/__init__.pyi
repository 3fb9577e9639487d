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
from .reinforcement import Reinforcement
from .self_play import SelfPlay
from .trainer import SupervisedTrainer, Trainer, run_training

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
    "SelfPlay",
    "SelfPlayConfig",
    "SupervisedTrainer",
    "Trainer",
    "run_training",
]
