"""Root configurations as the command composes them."""

import hydra

from knotflow.experiments.config import HOME, register


def composed(*overrides):
    register()
    with hydra.initialize_config_dir(str(HOME / "conf"), version_base="1.3"):
        return hydra.compose("config", overrides=list(overrides))
