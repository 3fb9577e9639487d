"""`python -m knotflow +experiment=NAME [budget=smoke] [key=value ...]`."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig

from knotflow.config import register
from knotflow.overrides import OverrideError, checked
from knotflow.workflow import Experiment, WorkersConfig, Workflow, code_state, run_all
from knotflow.workflow.provenance import library_versions

PACKAGE = Path(__file__).parent
HOME = PACKAGE if (PACKAGE / "conf").is_dir() else PACKAGE.parents[1]
"""Holds conf/ and workflows/: inside an installed package, or at the top of a checkout."""


@hydra.main(config_path=str(HOME / "conf"), config_name="config", version_base="1.3")
def main(config: DictConfig) -> None:
    """Run the workflow of an experiment, or those of several one after the other."""
    import knotflow.workflow.stages  # noqa: F401  registers them; takes seconds, so only now

    register()  # again, for a launcher may have sent this function to another process
    try:
        asked = [_alone(name) for name in config.experiments] or [config]
        folders = run_all(
            [_experiment(one) for one in asked],
            code=code_state(PACKAGE),
            budget=config.budget,
            metrics=config.metrics,
            workers=WorkersConfig(**config.workers),
        )
    except (ValueError, RuntimeError, OSError, ModuleNotFoundError) as error:
        if os.environ.get("HYDRA_FULL_ERROR") == "1":  # Hydra's own switch for a traceback
            raise
        notes = getattr(error, "__notes__", ())  # there only once something was noted
        sys.exit(f"error: {error}" + "".join(f"\n{note}" for note in notes))
    for folder in folders:
        _tell(folder / "outcome.json")


def _alone(name: str) -> DictConfig:
    """The configuration of an experiment as if it were asked for with the same overrides."""
    parsed = OverridesParser.create().parse_overrides(list(HydraConfig.get().overrides.task))
    own = ("experiment", "experiments")
    kept = [one.input_line or "" for one in parsed if one.key_or_group not in own]
    return hydra.compose("config", overrides=[f"+experiment={name}", *kept])


def _experiment(config: DictConfig) -> Experiment:
    """The experiment that a configuration describes."""
    workflow = Workflow.from_config(config.workflow)
    return Experiment(config.results_name, workflow, Path(config.results_dir), config.overwrite)


def _tell(file: Path) -> None:
    """Print what an experiment has to say, where it has; exit with 1 if it did not succeed."""
    if file.is_file():
        outcome = json.loads(file.read_text("utf-8"))
        print(f"\n{outcome['text']}")
        if not outcome["success"]:
            sys.exit(1)


if __name__ == "__main__":
    if "--version" in sys.argv[1:]:
        print(f"knotflow {library_versions().get('knotflow', 'unknown')}")
        sys.exit()
    os.environ["KNOTFLOW_HOME"] = str(HOME)
    register()
    try:
        sys.argv[1:] = checked(sys.argv[1:], HOME)
    except OverrideError as error:
        sys.exit(f"error: {error}")
    main()
