"""Tying as a task for others' methods: environments, public tasks, a leaderboard.

`TieEnv` is the Gymnasium environment "knotflow/Tie-v0", `TieVectorEnv` the same for many ropes at
once; both need the extra `gym`. `public_tasks` are the ropes and goals on which methods are
compared. Names are loaded when they are used, from the files that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["ENV_ID", "register_envs"]

ENV_ID = "knotflow/Tie-v0"


def register_envs() -> None:
    """Register the environment with Gymnasium, where it is not yet; episodes end by themselves."""
    from gymnasium.envs.registration import register, registry

    if ENV_ID not in registry:
        environments = "knotflow.apps.tasks.environments"
        register(
            ENV_ID,
            entry_point=f"{environments}:TieEnv",
            vector_entry_point=f"{environments}:TieVectorEnv",
        )
