"""Runs a workflow: every stage once, ever; what is interrupted goes on from where it was. What only
finished stages were made from need not be there.

The results folder of an experiment, results/<experiment>/, is small and committed: tables, the
configuration of every stage in config.yaml, and where each comes from in run.json.
"""

from __future__ import annotations

import json
import logging
import platform
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from knotflow.threads import cpus, one_thread
from knotflow.workflow import store
from knotflow.workflow.key import digest
from knotflow.workflow.shards import StageRun, WorkersConfig
from knotflow.workflow.stage import WorkflowError
from knotflow.workflow.store import StageFolder
from knotflow.workflow.workflow import Node, Source, Workflow

CONFIG, RUN = "config.yaml", "run.json"
GENERATED = ("results", "reports", "README.md", "docs")
"""Made by runs and reports themselves: they do not make the code dirty."""
PUBLISHED = "key code components libraries inputs seconds cpus commit dirty versions".split()
"""What run.json keeps of the record of a stage."""
POLL = 0.2
"""Seconds between two looks at what another process makes."""
log = logging.getLogger(__name__)


def run_workflow(
    workflow: Workflow,
    results_dir: Path,
    *,
    name: str = "",
    budget: str = "",
    overrides: Sequence[str] = (),
    workers: WorkersConfig | None = None,
) -> Path:
    """Run what is not finished yet and fill results_dir/<name>/; returns that folder.

    Runs of the same results_dir share the work: each makes the first stage that no other makes and
    that waits for none.

    `results_dir` holds experiments and `stages/`; `name` is that of the results folder, by default
    the workflow's, and `budget` and `overrides` go into run.json. Without `workers`, shards run one
    after the other in this process.

    Raises:
        WorkflowError: the folder has results of another workflow, or no name of one; or a stage did
            not make a file that the results name.
        DamagedStageError: a finished stage's output was changed.
    """
    results_dir, name = Path(results_dir).absolute(), name or workflow.name
    folder = results_dir / name
    _check_folder(folder, name, workflow)
    folders = {node: workflow.folder(node, results_dir) for node in workflow.nodes}
    log.info("%s: %s", name, workflow.caption)
    needed = _needed(workflow, folders)
    for node, one in folders.items():
        log.info("  %-7s %-32s %s", one.state() if node in needed else "-", node, one.relative)
    code = code_state(Path(__file__).parent)
    workers = workers or WorkersConfig(jobs=1)
    records = {
        node: workflow.identities[node] | {"key": workflow.keys[node]} for node in workflow.nodes
    }
    waiting = [node for node in workflow.nodes if node in needed]

    def make_next() -> bool:
        ready = (node for node in waiting if not workflow.nodes[node].needs() & {*waiting})
        for node in ready:
            if made := _make(workflow.nodes[node], workflow, folders, workers, code):
                records[node] = made
                waiting.remove(node)
                return True
        return False

    while waiting:
        _once_free(make_next, f"it makes {folders[waiting[0]].relative}")
    head = {"experiment": name, "budget": budget, "overrides": [*overrides]}

    def publish_all() -> bool:
        with store.locked(results_dir / "stages" / f"{name}.lock") as held:
            if held:
                publish(workflow, folder, folders, records, head)
            return held

    _once_free(publish_all, f"it publishes {name}")
    seconds = sum(record.get("seconds", 0.0) for record in records.values())
    log.info("%s: finished, %.0f s in all; results in %s", name, seconds, folder)
    return folder


def _once_free(work: Callable[[], bool], waiting: str) -> None:
    """Do `work`, which another process may have in hand, as soon as it can be done."""
    if work():
        return
    print(f"waiting for another process: {waiting}", flush=True)
    while not work():
        time.sleep(POLL)


def _check_folder(folder: Path, name: str, workflow: Workflow) -> None:
    if Path(name).name != name or name in ("stages", ".."):
        raise WorkflowError(f"results_name={name}: it is the name of a folder, and not stages")
    if (run := folder / RUN).is_file():
        other = read_run(run).get("workflow", workflow.name)
        if other != workflow.name:
            raise WorkflowError(
                f"{folder} has results of {other}, which those of {workflow.name} would replace: "
                "give them another results_name"
            )


def _needed(workflow: Workflow, folders: Mapping[str, StageFolder]) -> set[str]:
    """Nodes whose output is there, or is taken by the results or by what is to be made."""
    needed = {node for node, _ in (*workflow.results.values(), *workflow.ships.values())}
    needed = needed or {*workflow.nodes}
    for name in reversed([*workflow.nodes]):
        if folders[name].state() == "done":
            needed.add(name)
        elif name in needed:
            needed |= workflow.nodes[name].needs()
    return needed


def _make(
    node: Node,
    workflow: Workflow,
    folders: Mapping[str, StageFolder],
    workers: WorkersConfig,
    code: Mapping[str, Any],
) -> dict[str, Any] | None:
    """The record of a node's output, which is made if it is not there; None while another process
    makes it."""

    def path(source: Source) -> Path:
        return folders[source].final if isinstance(source, str) else source

    folder = folders[node.name]
    with folder.lock() as held:
        if folder.state() == "done":
            return folder.record()
        if not held:
            return None
        folder.partial.mkdir(parents=True, exist_ok=True)
        store.remove_abandoned(folder.partial)
        run = StageRun(folder.partial, folder.key, workers)
        run.load_seconds()
        log.info("%s: %s", node.name, node.caption or folder.relative)
        try:
            with one_thread():
                node.stage.function(run, **node.arguments, **node.each_input(path))
        except BaseException as error:
            if store.sizes(folder.partial):
                run.save_seconds()
                error.add_note(f"Stage {node.name} stopped; the same command goes on from there.")
            else:  # a wrong input, most often: nothing is there to go on from
                store.remove(folder.partial)
            raise
        return folder.finish(
            {
                **workflow.identities[node.name],
                "key": folder.key,
                "seconds": round(run.seconds(), 3),
                "cpus": cpus(),
                **code,
            }
        )


def publish(
    workflow: Workflow,
    folder: Path,
    folders: Mapping[str, StageFolder],
    records: Mapping[str, Mapping[str, Any]],
    head: Mapping[str, Any],
) -> None:
    """Copy the results, then write config.yaml and run.json; what earlier runs made else, goes."""
    folder.mkdir(parents=True, exist_ok=True)
    store.remove_abandoned(folder)
    earlier = read_run(run) if (run := folder / RUN).is_file() else {}
    for name in {*earlier.get("results", ())} - {*workflow.results}:
        store.remove(folder / name)
    for target, (node, path) in workflow.results.items():
        source = _existing(folders[node].final / path, node)
        with store.atomic(folder / target) as temporary:
            (shutil.copytree if source.is_dir() else shutil.copyfile)(source, temporary)
    stages = {
        node: {"stage": record["stage"], "caption": workflow.nodes[node].caption}
        | {part: record[part] for part in PUBLISHED if part in record}
        for node, record in records.items()
    }
    config = {
        node: {"stage": record["stage"], "config": record["arguments"]}
        for node, record in records.items()
    }
    with store.atomic(folder / CONFIG) as file:
        text = yaml.safe_dump({"workflow": workflow.name, "stages": config}, sort_keys=False)
        file.write_text(text, "utf-8")
    ships = {
        target: {"node": node, "digest": digest(_existing(folders[node].final / path, node))}
        for target, (node, path) in workflow.ships.items()
    }
    results = {name: f"{node}/{path}" for name, (node, path) in workflow.results.items()}
    head = {**head, "workflow": workflow.name, "caption": workflow.caption}
    store.write_json(folder / RUN, {**head, "stages": stages, "results": results, "ships": ships})


def read_run(file: Path) -> dict[str, Any]:
    """What run.json says.

    Raises:
        WorkflowError: it is no JSON object.
    """
    try:
        return dict(json.loads(file.read_text("utf-8")))
    except (TypeError, ValueError) as error:
        raise WorkflowError(f"{file}: cannot be read ({error}); run the experiment again") from None


def _existing(path: Path, node: str) -> Path:
    if not path.exists():
        raise WorkflowError(f"the results want {path.name} of node {node!r}, which made no such")
    return path


def code_state(folder: Path) -> dict[str, Any]:
    """Commit of the checkout that a folder is in, whether it has changes, and library versions.

    Without a checkout of knotflow, the commit is "none".
    """
    top = _git(folder, "rev-parse", "--show-toplevel")
    ours = top is not None and (Path(top) / "src" / "knotflow" / "workflow").is_dir()
    commit = _git(folder, "rev-parse", "HEAD") if ours else None
    excluded = [f":(exclude){name}" for name in GENERATED]
    changes = _git(Path(top or "."), "status", "--porcelain", "--", ".", *excluded)
    libraries = ("knotflow", "mujoco", "numpy", "torch")
    versions = {"python": platform.python_version()}
    for name in libraries:
        with suppress(metadata.PackageNotFoundError):  # a checkout that is not installed
            versions[name] = metadata.version(name)
    return {"commit": commit or "none", "dirty": bool(commit and changes), "versions": versions}


def _git(folder: Path, *arguments: str) -> str | None:
    """What git prints in a folder; None where it fails or is not installed."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None
