"""Makes "knotflow/Tie-v0" known to Gymnasium.

Gymnasium finds an installed knotflow through the entry point `gymnasium.envs`.
"""

from __future__ import annotations

ENV_ID = "knotflow/Tie-v0"


def register_envs() -> None:
    """Register the environment, where it is not yet; its episodes end by themselves."""
    # Not from `gymnasium` itself, which is still being imported when it asks its entry points.
    from gymnasium.envs.registration import register, registry

    if ENV_ID not in registry:
        module = "knotflow.apps.tasks.environments"
        register(
            ENV_ID,
            entry_point=f"{module}:TieEnv",
            vector_entry_point=f"{module}:TieVectorEnv",
        )
