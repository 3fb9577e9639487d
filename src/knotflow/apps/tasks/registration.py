"""Makes "knotflow/Tie-v0" known to Gymnasium.

An installed knotflow is found by Gymnasium itself, through the entry point `gymnasium.envs`.
"""

from __future__ import annotations

ENV_ID = "knotflow/Tie-v0"


def register_envs() -> None:
    """Register the environment, where it is not yet; its episodes end by themselves."""
    # Not from `gymnasium` itself, which is still being imported when it asks its entry points.
    from gymnasium.envs.registration import register, registry

    if ENV_ID not in registry:
        register(ENV_ID, entry_point="knotflow.apps.tasks.gym:TieEnv")
