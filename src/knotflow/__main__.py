"""`python -m knotflow +experiment=NAME [budget=smoke] [key=value ...]`."""

from __future__ import annotations

import os
import sys

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from knotflow.experiments.config import HOME, experiments, register


@hydra.main(config_path=str(HOME / "conf"), config_name="config", version_base="1.3")
def main(config: DictConfig) -> None:
    """Run the workflow of an experiment; `paper` and `everything` sweep over several."""
    if not config.workflow:
        sys.exit(f"error: choose one with +experiment=NAME; there are {', '.join(experiments())}")
    from knotflow.experiments.run import run_experiment  # imports every stage, which takes seconds

    def notes(error: BaseException) -> str:
        return "".join(f"\n{note}" for note in getattr(error, "__notes__", ()))

    try:
        run_experiment(config, HydraConfig.get().overrides.task)
    except KeyboardInterrupt as error:
        print(f"interrupted{notes(error)}", file=sys.stderr)
        sys.exit(130)
    except (ValueError, RuntimeError, OSError, ImportError) as error:
        if os.environ.get("HYDRA_FULL_ERROR") == "1":  # Hydra's own switch for a traceback
            raise
        text = f"error: {error}{notes(error)}"
        if HydraConfig.get().mode is not RunMode.MULTIRUN:
            sys.exit(text)
        print(text, file=sys.stderr)
        raise  # the sweep's other jobs run first


if __name__ == "__main__":
    register()
    main()
