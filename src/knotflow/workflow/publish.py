"""The small, committed folder results/<experiment>/: tables, config.yaml and run.json.

run.json is removed first and written last, so a folder with one is complete.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from . import durable
from .definition import Workflow
from .errors import ForeignResultsError, WorkflowError
from .signature import canonical_json, plain, runtime_fields

CONFIG, RUN = "config.yaml", "run.json"
TAKEN = ("stages", "metrics")  # folders of the workflow's own in the results folder
SHOWN = 12  # differing keys in an error


def experiment_folder(results_dir: Path, experiment: str) -> Path:
    """results/<experiment>/.

    Raises:
        WorkflowError: the name cannot be that of a results folder.
    """
    if not re.fullmatch(r"\w[\w.-]*", experiment) or experiment in TAKEN:
        raise WorkflowError(
            f"experiment {experiment!r}: its name becomes a folder's; use letters, digits, '_', "
            f"'-' and '.', and none of: {', '.join(TAKEN)}"
        )
    return results_dir / experiment


def resolved_config(workflow: Workflow) -> dict[str, Any]:
    """What config.yaml holds: every node with all its values, defaults included.

    `config` is what decides the result, `runtime` what does not (threads, device).
    """
    nodes = {}
    for name in workflow.order():
        config = workflow.config(name)
        node = workflow.stages[name]
        nodes[name] = {
            "stage": node.stage,
            "needs": dict(node.needs),
            "config": plain(config, with_runtime=False),
            "runtime": runtime_fields(config),
        }
    return {"workflow": workflow.name, "stages": nodes}


def refuse_foreign(folder: Path, config: Mapping[str, Any]) -> None:
    """Sees to it that `folder` holds nothing, or results of this configuration.

    Raises:
        ForeignResultsError: names the keys that differ and the ways out.
    """
    path = folder / CONFIG
    if not path.exists():
        return
    ways_out = (
        "Choose another results_dir=..., set overwrite=true to replace them, "
        "or use their configuration"
    )
    try:
        there = _decisive(yaml.safe_load(path.read_text("utf-8")))
    except (yaml.YAMLError, AttributeError, TypeError) as error:
        raise ForeignResultsError(f"{path} cannot be read. {ways_out}") from error
    here = _decisive(config)
    differing = [
        f"{key}: {there.get(key, 'nothing')!r} there, {here.get(key, 'nothing')!r} now"
        for key in sorted({*there, *here})
        if key not in there
        or key not in here
        or canonical_json(there[key]) != canonical_json(here[key])
    ]
    if differing:
        more = f"\n  and {len(differing) - SHOWN} more" if len(differing) > SHOWN else ""
        lines = "\n  ".join(differing[:SHOWN])
        raise ForeignResultsError(
            f"{folder} holds results of another configuration:\n  {lines}{more}\n{ways_out}"
        )


def missing_results(workflow: Workflow, node: str, output: Path) -> list[str]:
    """Paths that the workflow's results want from the node's output and that are not there."""
    return [
        str(path)
        for _, source, path in workflow.sources()
        if source == node and not (output / path).exists()
    ]


def publish(
    folder: Path,
    workflow: Workflow,
    outputs: Mapping[str, Path],
    config: Mapping[str, Any],
    record: Mapping[str, Any],
) -> None:
    """Copies the results, then writes config.yaml and run.json.

    Results that an earlier run of the experiment made and this one does not are deleted. Publishing
    again with nothing new changes no byte: what run.json says of a stage's making comes from the
    stage's own record, and one that was `run now` for this folder stays so.

    Args:
        folder: results/<experiment>/.
        workflow: says which files are results.
        outputs: node -> its finished folder.
        config: of `resolved_config`, with the `runtime` that each stage was made with.
        record: run.json; its `stages` hold each node's `signature` and `origin`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    durable.remove_temporaries(folder)
    earlier = _read_run(folder / RUN)
    for name in set(earlier.get("results", ())) - set(workflow.results):
        durable.remove(folder / name)
    (folder / RUN).unlink(missing_ok=True)
    for target, node, path in workflow.sources():
        _copy(outputs[node] / path, folder / target)
    with durable.atomic(folder / CONFIG) as temporary:
        temporary.write_text(yaml.safe_dump(dict(config), sort_keys=False), "utf-8")
    sizes = {name: size(folder / name) for name in workflow.results}
    durable.write_json(folder / RUN, _keep_origins(record, earlier) | {"bytes": sizes})


def size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _copy(source: Path, target: Path) -> None:
    with durable.atomic(target) as temporary:
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, temporary)


def _keep_origins(record: Mapping[str, Any], earlier: Mapping[str, Any]) -> dict[str, Any]:
    """The record, in which a stage output that was published before has its origin of then."""
    before = earlier.get("stages", {})
    stages = {}
    for name, node in record["stages"].items():
        known = before.get(name, {})
        same = node["origin"] == "shared" and known.get("signature") == node["signature"]
        stages[name] = {**node, "origin": known["origin"]} if same else node
    return {**record, "stages": stages}


def _read_run(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text("utf-8")))
    except (FileNotFoundError, ValueError):  # none, or one that is replaced below anyway
        return {}


def _decisive(config: Any) -> dict[str, Any]:
    """Flat dotted keys of everything in config.yaml but the runtime parts."""
    stages = {
        name: {key: value for key, value in node.items() if key != "runtime"}
        for name, node in config["stages"].items()
    }
    return _flat({"workflow": config["workflow"], "stages": stages})


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    if isinstance(value, Mapping) and value:
        return {
            key: leaf
            for name, item in value.items()
            for key, leaf in _flat(item, f"{prefix}.{name}" if prefix else str(name)).items()
        }
    return {prefix: value}
