from .config import (
    ImitationConfig,
    JointConfig,
    LearnerConfig,
    ReinforcementConfig,
    SelfPlayConfig,
)
from .independent import Imitation, Reinforcement
from .joint import JointFinetuning
from .learner import Learner
from .self_play import SelfPlay

__all__ = [
    "Imitation",
    "ImitationConfig",
    "JointConfig",
    "JointFinetuning",
    "Learner",
    "LearnerConfig",
    "Reinforcement",
    "ReinforcementConfig",
    "SelfPlay",
    "SelfPlayConfig",
]
