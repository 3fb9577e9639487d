from .config import (
    ExplorationConfig,
    ImitationConfig,
    LearnerConfig,
    ReinforcementConfig,
    SelfPlayConfig,
)
from .independent import Imitation, Reinforcement
from .learner import Learner
from .self_play import SelfPlay
from .trainer import SupervisedTrainer, Trainer, run_training

__all__ = [
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
