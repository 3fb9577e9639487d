"""From a composed configuration to a run of its workflow, and to what is stale."""

from __future__ import annotations

import logging
import pkgutil
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

import knotflow.experiments
from knotflow.experiments.config import HOME, PACKAGE, experiments, register, sections
from knotflow.workflow import (
    WorkersConfig,
    Workflow,
    WorkflowError,
    read_workflow,
    run_workflow,
)
from knotflow.workflow.key import digest
from knotflow.workflow.run import read_run
from knotflow.workflow.stage import STAGES

log = logging.getLogger(__name__)
_ELSEWHERE = re.compile(
    r"\+{0,2}((experiment|workflows@workflow|budget|results_dir|results_name)=|(workers|hydra)\b)"
)
"""Overrides that no stage takes."""

for module in pkgutil.iter_modules(knotflow.experiments.__path__, "knotflow.experiments."):
    import_module(module.name)  # registers its stages


def run_experiment(config: DictConfig, overrides: Iterable[str] = ()) -> Path:
    """Run the workflow of a root configuration; returns the results folder.

    Raises:
        WorkflowError: see `read_workflow`; or an override adds a value that no stage takes.
    """
    workflow, overrides = workflow_of(config), [*overrides]
    check_added(workflow, overrides)
    kept = [one for one in overrides if not _ELSEWHERE.match(one)]
    for one in kept if GlobalHydra.instance().is_initialized() else ():
        others = [other for other in overrides if other != one]
        without = hydra.compose("config", overrides=others)
        if without == config:
            log.warning("%s changes nothing: it is the default", one)
        elif workflow_of(without) == workflow:
            log.warning("%s changes nothing: no stage of %s takes it", one, workflow.name)
    return run_workflow(
        workflow,
        Path(config.results_dir),
        name=config.results_name,
        budget=config.budget,
        overrides=kept,
        workers=WorkersConfig(**config.workers),
    )


def check_added(workflow: Workflow, overrides: Iterable[str]) -> None:
    """Refuse `+section.key=value` where no stage takes the key: Hydra adds whatever it is told."""
    every = {name for stage in STAGES.values() for name in stage.arguments}
    for one in overrides:
        section, _, place = one.partition("=")[0].partition(".")
        key = place.partition(".")[0]
        if section[0] == "+" and section.lstrip("+") in sections() and key and key not in every:
            own = {name for node in workflow.nodes.values() for name in node.stage.arguments}
            raise WorkflowError(
                f"{one}: no stage takes {key!r}; those of {workflow.name!r} take "
                f"{', '.join(sorted(own))}"
            )


def workflow_of(config: DictConfig) -> Workflow:
    """The bound workflow of a root configuration, see `read_workflow`."""
    root = OmegaConf.to_container(config, resolve=True)
    assert isinstance(root, dict)
    return read_workflow({str(key): value for key, value in root.items()}, HOME / "conf")


@dataclass(frozen=True)
class Stale:
    """A committed result, or shipped weights, that today's code would not produce."""

    where: str
    """The experiment's folder and the stage's node, or the path of the weights."""
    reasons: tuple[str, ...]
    """What is another now."""


def stale(results_dir: Path) -> Iterator[Stale]:
    """Compare the keys in results_dir/<experiment>/run.json with those of today's code.

    Raises:
        WorkflowError: there is none, or one that no run wrote.
    """
    register()
    if not (files := sorted(results_dir.glob("*/run.json"))):
        raise WorkflowError(f"{results_dir}: there is no */run.json, nothing to compare")
    for file in files:
        run = read_run(file)
        if not {"budget", "stages"} <= run.keys():
            raise WorkflowError(f"{file}: has no budget or no stages, and is no run's")
        experiment = run.get("workflow", file.parent.name)
        if experiment not in experiments():
            yield Stale(file.parent.name, ("there is no such experiment",))
            continue
        with hydra.initialize_config_dir(str(HOME / "conf"), version_base="1.3"):
            overrides = [f"+experiment={experiment}", f"budget={run['budget']}"]
            overrides += run.get("overrides", [])
            try:
                workflow = workflow_of(hydra.compose("config", overrides=overrides))
            except (HydraException, WorkflowError) as error:
                reason = str(error).splitlines()[0]
                yield Stale(file.parent.name, (f"its options do not fit today's: {reason}",))
                continue
        for name in workflow.nodes:
            made = run["stages"].get(name, {})
            if made.get("key") != workflow.keys[name]:
                reasons = tuple(_differences(made, workflow.identities[name]))
                yield Stale(f"{file.parent.name}/{name}", reasons)
        for target, shipped in run.get("ships", {}).items():  # from the paper's counts alone
            if run["budget"] == "paper" and digest(PACKAGE / target) != shipped["digest"]:
                yield Stale(target, (f"not what {experiment} made",))


def _differences(made: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """What differs between how a stage was made and how it would be made now, in words."""
    if not made:
        return ["not made yet"]
    if "key" not in made:
        return ["made before keys were complete"]
    found = ["the stage's code"] if made.get("code") != now["code"] else []
    for part in ("components", "libraries", "inputs"):
        before, after = made.get(part) or {}, now[part]
        for name in sorted({*before, *after}):
            old, new = before.get(name), after.get(name)
            if old != new:
                change = f"{name} {old} -> {'not installed' if new == '' else new}"
                found.append(f"input {name}" if part == "inputs" else change)
    return found or ["arguments"]
