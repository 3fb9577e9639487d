"""`python -m knotflow +experiment=NAME [budget=smoke] [key=value ...]`."""

from __future__ import annotations

import json
import os
import re
import sys
from dataclasses import fields
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig

from knotflow.config import PlanRequest, register
from knotflow.workflow import Experiment, WorkersConfig, Workflow, code_state, run_all

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
    except (ValueError, RuntimeError, OSError) as error:
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


def _tell(outcome: Path) -> None:
    """Print what an experiment has to say, where it has; exit with 1 if it did not succeed."""
    if outcome.is_file():
        told = json.loads(outcome.read_text("utf-8"))
        print(f"\n{told['text']}")
        if not told["success"]:
            sys.exit(1)


def _check_experiment() -> None:
    """Name the experiments, where none or an unknown one is asked for.

    Hydra's own message speaks of config groups; people ask for experiments.
    """
    names = sorted(path.stem for path in (HOME / "conf" / "experiment").glob("*.yaml"))
    asked = [word.partition("=")[2] for word in sys.argv[1:] if word.startswith("+experiment=")]
    options = {"--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i"}
    if options & set(sys.argv[1:]):
        return
    known = f"experiments are: {', '.join(names)}"
    if not asked:
        sys.exit(f"error: choose one with +experiment=NAME; {known}")
    for name in asked[0].split(","):
        if name not in names:
            sys.exit(f"error: there is no experiment {name!r}; {known}")
        _check_asked(name)


def _check_asked(experiment: str) -> None:
    """Refuse what says what to plan where the experiment has no use for it, else write it in full.

    People ask for `knot=...`; in the configuration it is `plan.knot`.
    """
    workflow = HOME / "workflows" / f"{experiment}.yaml"
    text = workflow.read_text("utf-8") if workflow.is_file() else ""  # paper has none of its own
    keys = [one.name for one in fields(PlanRequest)]
    takes = [key for key in keys if f"${{plan.{key}}}" in text]
    for i, word in enumerate(sys.argv):
        key = re.split(r"[.=]", word.removeprefix("plan."))[0]
        if i and key in keys and "=" in word and key not in takes:
            sys.exit(
                f"error: {word!r} says what to plan, but the experiment {experiment} takes "
                f"{', '.join(takes) or 'nothing of that kind'}; +experiment=overhand plans one"
            )
        if i and key in keys and "=" in word:
            sys.argv[i] = f"plan.{word.removeprefix('plan.')}"


if __name__ == "__main__":
    os.environ["KNOTFLOW_HOME"] = str(HOME)
    register()
    _check_experiment()
    main()
