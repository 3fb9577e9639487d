"""Tying as a task for others' methods: an environment, public tasks, and how methods do in them.

`TieEnv` is the Gymnasium environment "knotflow/Tie-v0" (extra `gym`); `gymnasium.make_vec` makes
many. `public_tasks` are the ropes and goals on which methods are compared. A name is loaded when it
is used, from the file that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["ENV_ID", "register_envs"]

ENV_ID = "knotflow/Tie-v0"


def register_envs() -> None:
    """Register the environment with Gymnasium, where it is not yet; episodes end by themselves."""
    from gymnasium.envs.registration import register, registry

    if ENV_ID not in registry:
        register(ENV_ID, entry_point="knotflow.apps.tasks.environments:TieEnv")
