from .config import ImitationConfig, JointConfig, LearnerConfig, ReinforcementConfig, SelfPlayConfig
from .independent import Imitation, Reinforcement
from .joint import JointFinetuning
from .learner import Learner
from .self_play import SelfPlay, completed

__all__ = [
    "Imitation", "ImitationConfig", "JointConfig", "JointFinetuning", "Learner", "LearnerConfig",
    "Reinforcement", "ReinforcementConfig", "SelfPlay", "SelfPlayConfig", "completed",
]  # fmt: skip
