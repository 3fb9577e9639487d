from .environments import TieEnv
from .leaderboard import evaluate, public_tasks
from .task import TieTask, action_code, goal_codes, to_box, to_splines

ENV_ID: str

def register_envs() -> None: ...

__all__ = [
    "ENV_ID", "TieEnv", "TieTask", "action_code", "evaluate", "goal_codes", "public_tasks",
    "register_envs", "to_box", "to_splines",
]  # fmt: skip
