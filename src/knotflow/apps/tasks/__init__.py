"""Knot tying as a benchmark: an environment, public tasks and their evaluation.

`TieEnv` is the Gymnasium environment "knotflow/Tie-v0" (extra `gym`); `gymnasium.make_vec` makes
many. `public_tasks` are the ropes and goals on which methods are compared. Names are imported on
first use, see `__init__.pyi`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["ENV_ID", "register_envs"]

ENV_ID = "knotflow/Tie-v0"


def register_envs() -> None:
    """Register the environment with Gymnasium, unless it is registered already."""
    from gymnasium.envs.registration import register, registry

    if ENV_ID not in registry:
        register(ENV_ID, entry_point="knotflow.apps.tasks.environments:TieEnv")
