"""Runs a workflow: every stage once, ever; what is interrupted goes on from where it was."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotflow.threads import one_thread

from . import durable, publish
from .context import StageContext
from .definition import StageNode, Workflow
from .durable import explain_full_disk, remove_temporaries
from .errors import WorkflowError
from .memory import PeakMemory
from .metrics import DEFAULT_METRICS, check_metrics
from .provenance import CodeState, library_versions
from .signature import plain, runtime_fields, signature
from .stage import get_stage
from .store import Clock, StageFolder
from .workers import WorkersConfig

__all__ = ["StageNode", "Workflow", "run"]


@dataclass(frozen=True)
class Step:
    """A node on its way through a run."""

    name: str
    node: StageNode
    config: Any
    folder: StageFolder
    input_signatures: Mapping[str, str]


def run(
    workflow: Workflow,
    *,
    experiment: str,
    results_dir: Path,
    code: CodeState,
    budget: str = "",
    overwrite: bool = False,
    metrics: str = DEFAULT_METRICS,
    workers: WorkersConfig | None = None,
) -> Path:
    """Runs what is not finished yet and fills results_dir/<experiment>/; returns that folder.

    Args:
        workflow: checked when it was made.
        experiment: name of the results folder.
        results_dir: holds experiments, `stages/` and `metrics/`; made if missing.
        code: goes into the record of each stage that is made now; one that is finished keeps
            the commit that made it, one that is resumed keeps those of its earlier attempts.
        budget: goes into run.json.
        overwrite: replace results of another configuration.
        metrics: kind of metrics logger the stages get, see `metrics.open_metrics`.
        workers: where stages run their shards; by default one after the other in this process.

    Raises:
        WorkflowError: the experiment's name cannot be a folder's, or a stage did not make a file
            that the results name.
        ForeignResultsError: the results folder is of another configuration (and not `overwrite`);
            like all but the next one and a missing result, raised before any stage runs.
        DiskFullError: no room left; says where, and that a rerun goes on.
        DamagedStageError: a finished stage's output was changed.
    """
    check_metrics(metrics)
    workers = workers or WorkersConfig(jobs=1)
    results_dir = Path(results_dir).absolute()
    folder = publish.experiment_folder(results_dir, experiment)
    config = publish.resolved_config(workflow)
    if not overwrite:
        publish.refuse_foreign(folder, config)
    steps = plan(workflow, results_dir)
    print(f"{experiment}: {workflow.caption}" if workflow.caption else experiment)
    for step in steps:
        print(_plan_line(step), flush=True)

    entries: dict[str, Any] = {}
    outputs: dict[str, Path] = {}
    for step in steps:
        inputs = {name: outputs[source] for name, source in step.node.needs.items()}
        record, origin = _make(step, inputs, results_dir, code, metrics, workers)
        outputs[step.name] = step.folder.final
        entries[step.name] = _entry(step, record, origin)
        config["stages"][step.name]["runtime"] = record["runtime"]  # as made
        if missing := publish.missing_results(workflow, step.name, step.folder.final):
            raise WorkflowError(
                f"workflow {workflow.name!r}: results want {missing} of node {step.name!r}, "
                f"which made {sorted(record['files']) or 'no files'} in {step.folder.final}"
            )
    record = {
        "experiment": experiment,
        "workflow": workflow.name,
        "caption": workflow.caption,
        "budget": budget,
        "stages": entries,
        "results": dict(workflow.results),
    }
    with explain_full_disk(folder, f"experiment {experiment!r}"):
        publish.publish(folder, workflow, outputs, config, record)
    print(f"{experiment}: finished, results in {folder}")
    for name, entry in entries.items():
        print(f"  {name:<24} {entry['seconds']:>10.1f} s  {entry['origin']}", flush=True)
    return folder


def plan(workflow: Workflow, results_dir: Path) -> list[Step]:
    """The steps in the order in which they run, with every finished output checked.

    Raises:
        DamagedStageError: see `StageFolder.record`.
    """
    steps: dict[str, Step] = {}
    for name in workflow.order():
        node = workflow.stages[name]
        stage, config = get_stage(node.stage), workflow.config(name)
        before = {given: steps[source].folder.signature for given, source in node.needs.items()}
        identity = signature(stage.name, stage.version, config, before, stage.packages)
        folder = StageFolder(results_dir, stage.name, identity)
        if folder.state() == "done":
            folder.record()
        steps[name] = Step(name, node, config, folder, before)
    return list(steps.values())


def _make(
    step: Step,
    inputs: Mapping[str, Path],
    results_dir: Path,
    code: CodeState,
    metrics: str,
    workers: WorkersConfig,
) -> tuple[dict[str, Any], str]:
    """The stage's record, and whether it was `shared` (finished before) or `run now`."""
    folder = step.folder
    with explain_full_disk(folder.partial, f"stage {step.name!r}"):
        if folder.state() == "done":
            return folder.record(), "shared"
        with folder.lock():
            if folder.state() == "done":  # by the process we waited for
                return folder.record(), "shared"
            recovered = folder.recover()
            if recovered is not None:
                return recovered, "run now"
            folder.partial.mkdir(parents=True, exist_ok=True)
            remove_temporaries(folder.partial)
            clock = Clock(folder.partial, code)
            clock.save()
            with PeakMemory() as memory:
                shards = _call(step, inputs, results_dir, metrics, workers, clock)
            stage = get_stage(step.node.stage)
            record = {
                "stage": stage.name,
                "version": stage.version,
                "packages": stage.packages,
                "signature": folder.signature,
                "config": plain(step.config, with_runtime=False),
                "runtime": runtime_fields(step.config),
                "inputs": dict(step.input_signatures),
                "seconds": round(clock.seconds(), 3),
                "memory_mb": round(memory.megabytes),
                "shards": shards,
                "cpus": os.cpu_count(),
                **clock.provenance(),
                "versions": library_versions(),
            }
            return folder.finish(record), "run now"


def _call(
    step: Step,
    inputs: Mapping[str, Path],
    results_dir: Path,
    metrics: str,
    workers: WorkersConfig,
    clock: Clock,
) -> int:
    """Runs the stage; returns how many of its shards could run side by side."""
    folder = step.folder
    context = StageContext(
        folder.partial,
        folder.signature,
        step.input_signatures,
        metrics=metrics,
        metrics_folder=results_dir / "metrics",
        metrics_name=f"{folder.stage}/{folder.signature}",
        workers=workers,
        after_save=clock.save_sometimes,
    )
    print(f"{step.name}: {step.node.caption or folder.relative}", flush=True)
    try:
        with one_thread():
            get_stage(folder.stage).function(step.config, inputs, context)
    except BaseException as error:
        with suppress(OSError):  # a full disk: this attempt's seconds are all that is lost
            if folder.began() or not isinstance(error, Exception):
                clock.save()
                error.add_note(
                    f"Stage {step.name!r} stopped. What it finished is kept in {folder.partial}; "
                    "the same command goes on from there."
                )
                if isinstance(error, Exception):
                    error.add_note(f"The traceback is in {folder.keep_traceback(error)}.")
            else:  # a wrong input, most often: nothing is there to go on from
                durable.remove(folder.partial)
        raise
    finally:
        context.close()
    return context.shards


def _entry(step: Step, record: Mapping[str, Any], origin: str) -> dict[str, Any]:
    """What run.json says of a node: of its making, what the stage's own record says."""
    as_made = "seconds memory_mb shards cpus commit commits commit_date dirty versions".split()
    return {
        "stage": step.node.stage,
        "version": record["version"],
        "packages": record["packages"],
        "signature": step.folder.signature,
        "needs": dict(step.node.needs),
        "caption": step.node.caption,
        "origin": origin,
        **{key: record[key] for key in as_made if key in record},
    }


def _plan_line(step: Step) -> str:
    state = step.folder.state()
    line = f"  {state:<8}{step.name:<24} {step.folder.relative}"
    if state == "done":
        return f"{line}  (made in {step.folder.record()['seconds']:.0f} s)"
    if state == "resume":
        return f"{line}  ({Clock(step.folder.partial).earlier:.0f} s so far)"
    return line
