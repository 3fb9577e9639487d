"""A workflow that cannot run is refused, with what would be right."""

from __future__ import annotations

from typing import Any

import pytest
from omegaconf import OmegaConf

from knotflow.workflow import StageNode, UnknownStageError, Workflow, WorkflowError


def test_reads_plain_data(mapping: dict[str, Any]) -> None:
    workflow = Workflow.from_config(mapping)
    assert workflow.order() == ["toy_count", "adding"]
    assert workflow.stages["toy_count"] == StageNode("toy_count", {}, {"machine": {"scale": 3}})
    assert workflow.config("adding").offset == 0.5
    assert workflow.config("toy_count").machine.scale == 3


def test_reads_hydra_config(mapping: dict[str, Any]) -> None:
    mapping["caption"] = "${name} with a reference"
    workflow = Workflow.from_config(OmegaConf.create(mapping))
    assert workflow.caption == "toy with a reference"
    assert workflow.stages == Workflow.from_config(mapping).stages


CHANGES: dict[str, tuple[str, Any, str]] = {
    "unknown stage": (
        "stages.adding.stage",
        "toy_smu",
        r"node 'adding': unknown stage 'toy_smu'; stages are: .*toy_count, toy_sum",
    ),
    "unknown node": (
        "stages.adding.needs.counts",
        "counting",
        r"input 'counts' comes from an unknown node 'counting'; nodes are: adding, toy_count",
    ),
    "unknown input": ("stages.adding.needs.more", "toy_count", r"the stage takes \['counts'\]"),
    "missing input": ("stages.adding.needs", None, r"given the inputs \[\], but the stage takes"),
    "misspelt key": (
        "stages.adding.config.ofset",
        1,
        r"node 'adding' \(stage 'toy_sum'\): config key 'ofset'.*valid keys: offset, factors",
    ),
    "misspelt inner key": (
        "stages.toy_count.config.machine.scael",
        1,
        r"config key 'machine.scael'.*valid keys: scale, threads",
    ),
    "wrong type": ("stages.toy_count.config.shards", "many", r"config key 'shards'.*'many'"),
    "not a list": ("stages.adding.config.factors", 3, r"config key 'factors'"),
    "not a group": ("stages.toy_count.config.machine", 3, r"config: .*keys: shards, machine"),
    "forbidden value": ("stages.adding.config.offset", -1.0, r"offset is -1.0, must be >= 0"),
    "config is no mapping": ("stages.adding.config", [1], r"'adding', config must be a mapping"),
    "unknown node key": ("stages.adding.need", {}, r"\['need'\]; valid ones: stage, needs, config"),
    "unknown key": ("result", {}, r"\['result'\]; valid ones: name, caption, stages, results"),
    "result of no node": ("results.x", "summing/sum.csv", r"unknown node 'summing'; nodes are:"),
    "result without file": ("results.x", "adding", r"'<node>/<file in its output>', not 'adding'"),
    "result outside": ("results.x", "adding/../../y", r"'<node>/<file in its output>'"),
    "result to outside": ("results.../x", "adding/sum.csv", r"a name in the results folder"),
    "result of the runner": ("results.run", {}, r"unknown node"),
    "no stages": ("stages", {}, r"has no stages"),
    "no name": ("name", "", r"needs a name"),
}


@pytest.mark.parametrize("case", CHANGES)
def test_refused(mapping: dict[str, Any], case: str) -> None:
    key, value, message = CHANGES[case]
    *folders, last = ["results", "../x"] if "../x" in key else key.split(".")
    place: Any = mapping
    for folder in folders:
        place = place[folder]
    place[last] = value
    with pytest.raises(WorkflowError, match=message):
        Workflow.from_config(mapping)


def test_unknown_stage_has_its_own_error(mapping: dict[str, Any]) -> None:
    mapping["stages"]["adding"]["stage"] = "x"
    with pytest.raises(UnknownStageError):
        Workflow.from_config(mapping)


def test_runners_own_files_are_not_for_results(mapping: dict[str, Any]) -> None:
    mapping["results"]["run.json"] = "adding/sum.csv"
    with pytest.raises(WorkflowError, match="config.yaml and run.json are written by the runner"):
        Workflow.from_config(mapping)


def test_cycle_is_named(mapping: dict[str, Any]) -> None:
    entry = {"stage": "toy_sum"}
    mapping["stages"] = {
        "a": entry | {"needs": {"counts": "b"}},
        "b": entry | {"needs": {"counts": "a"}},
    }
    with pytest.raises(WorkflowError, match=r"need each other: (a -> b -> a|b -> a -> b)"):
        Workflow.from_config(mapping)


def test_missing_value_in_hydra_config(mapping: dict[str, Any]) -> None:
    mapping["stages"]["adding"]["config"]["offset"] = "???"
    with pytest.raises(WorkflowError, match="stages.adding.config.offset"):
        Workflow.from_config(OmegaConf.create(mapping))
