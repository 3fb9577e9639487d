from .config import (
    ImitationConfig,
    LearnerConfig,
    ReinforcementConfig,
    SelfPlayConfig,
)
from .independent import Imitation, Reinforcement
from .learner import Learner
from .self_play import SelfPlay

__all__ = [
    "Imitation",
    "ImitationConfig",
    "Learner",
    "LearnerConfig",
    "Reinforcement",
    "ReinforcementConfig",
    "SelfPlay",
    "SelfPlayConfig",
]
