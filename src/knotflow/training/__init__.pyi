from .config import (
    ImitationConfig,
    JointConfig,
    KnotsConfig,
    LearnerConfig,
    ReinforcementConfig,
    SelfPlayConfig,
)  # fmt: skip
from .independent import Imitation, Reinforcement
from .joint import JointFinetuning
from .knots import KnotFinetuning
from .learner import Learner
from .self_play import SelfPlay, completed

__all__ = [
    "Imitation", "ImitationConfig", "JointConfig", "JointFinetuning", "KnotFinetuning",
    "KnotsConfig", "Learner", "LearnerConfig", "Reinforcement", "ReinforcementConfig", "SelfPlay",
    "SelfPlayConfig", "completed",
]  # fmt: skip
