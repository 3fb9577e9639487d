from .batched import BatchedTieEnv
from .encoding import action_code, goal_codes, to_box, to_splines
from .episodes import Episodes, StepResult
from .evaluation import evaluate
from .gym import TieEnv
from .public import public_tasks
from .registration import ENV_ID, register_envs
from .task import TieTask

__all__ = [
    "ENV_ID",
    "BatchedTieEnv",
    "Episodes",
    "StepResult",
    "TieTask",
    "TieEnv",
    "action_code",
    "evaluate",
    "goal_codes",
    "public_tasks",
    "register_envs",
    "to_box",
    "to_splines",
]
