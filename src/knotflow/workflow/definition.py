"""A workflow: which stages, what feeds what, and which of their files are the results.

name: single_stage
caption: Success rates of single actions (Sec. VII-A, Fig. 6)
stages:
  demonstrations: {config: {copies: 480}, caption: noisy copies of the demonstrations}
  evaluation:
    stage: evaluate                     # where it differs from the node's name
    needs: {demonstrations: demonstrations}   # the stage's input: the node that makes it
    config: {trials: 50}
results:
  success_rates.csv: evaluation/success_rates.csv
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from graphlib import CycleError, TopologicalSorter
from pathlib import PurePosixPath
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from .errors import WorkflowError
from .stage import get_stage

RESERVED = ("config.yaml", "run.json")  # what the runner itself writes beside the results


@dataclass(frozen=True)
class StageNode:
    """One use of a stage."""

    stage: str
    needs: Mapping[str, str] = field(default_factory=dict)
    """Name of the stage's input -> name of the node that makes it."""
    config: Mapping[str, Any] = field(default_factory=dict)
    """Deltas from the defaults of the stage's config dataclass."""
    caption: str = ""


@dataclass(frozen=True)
class Workflow:
    """Nodes by name, checked when made: an instance can be run.

    Raises:
        WorkflowError: an unknown stage (`UnknownStageError`), input or node; a cycle; a config with
            a misspelt key, a wrong type or a missing value; a result that no node makes. The
            message names the workflow and the node, and what would be right.
    """

    name: str
    caption: str
    stages: Mapping[str, StageNode]
    results: Mapping[str, str] = field(default_factory=dict)
    """File or folder in results/<experiment>/ -> "<node>/<file or folder in its output>"."""

    def __post_init__(self) -> None:
        """Checks everything that can be known before anything runs."""
        if not self.stages:
            raise WorkflowError(f"workflow {self.name!r} has no stages")
        for name, node in self.stages.items():
            self._check_needs(name, node)
        self.order()
        for name in self.stages:
            self.config(name)
        for target, source in self.results.items():
            self._check_result(target, source)

    @classmethod
    def from_config(cls, mapping: Mapping[str, Any]) -> Workflow:
        """Reads plain data or a DictConfig of the form shown at the top of this file.

        A node without `stage` uses the stage of its own name.
        """
        if isinstance(mapping, DictConfig):
            mapping = _plain_config(mapping)
        where = f"workflow {mapping.get('name', '?')!r}"
        known = _known_keys(mapping, cls, where)
        if not known.get("name"):
            raise WorkflowError("a workflow needs a name")
        nodes = {}
        for name, entry in _mapping(known.get("stages"), f"{where}, stages").items():
            at = f"{where}, node {name!r}"
            entry = _known_keys(entry, StageNode, at)
            nodes[name] = StageNode(
                stage=str(entry.get("stage") or name),
                needs=_mapping(entry.get("needs"), f"{at}, needs"),
                config=_mapping(entry.get("config"), f"{at}, config"),
                caption=str(entry.get("caption") or ""),
            )
        results = _mapping(known.get("results"), f"{where}, results")
        return cls(str(known["name"]), str(known.get("caption") or ""), nodes, results)

    def order(self) -> list[str]:
        """Names of the nodes, each after those it needs."""
        try:
            graph = {name: list(node.needs.values()) for name, node in self.stages.items()}
            return list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            cycle = " -> ".join(reversed(error.args[1]))  # each needs the next
            raise WorkflowError(f"workflow {self.name!r}: nodes need each other: {cycle}") from None

    def config(self, name: str) -> Any:
        """The typed configuration of a node: an instance of its stage's config dataclass."""
        node = self.stages[name]
        schema = OmegaConf.structured(get_stage(node.stage).config_type)
        try:
            return OmegaConf.to_object(OmegaConf.merge(schema, dict(node.config)))
        except (OmegaConfBaseException, TypeError, ValueError) as error:
            raise WorkflowError(f"{self._at(name)}: {_explain(error, schema)}") from error

    def sources(self) -> Iterator[tuple[str, str, PurePosixPath]]:
        """Each result as (its name, the node it comes from, its path in that node's output)."""
        for target, source in self.results.items():
            node, _, path = str(source).partition("/")
            yield target, node, PurePosixPath(path)

    def _at(self, name: str) -> str:
        return f"workflow {self.name!r}, node {name!r} (stage {self.stages[name].stage!r})"

    def _check_needs(self, name: str, node: StageNode) -> None:
        try:
            stage = get_stage(node.stage)
        except WorkflowError as error:
            raise type(error)(f"workflow {self.name!r}, node {name!r}: {error}") from None
        for given, source in node.needs.items():
            if source not in self.stages:
                raise WorkflowError(
                    f"{self._at(name)}: its input {given!r} comes from an unknown node {source!r}; "
                    f"nodes are: {', '.join(self.stages)}"
                )
        if stage.inputs is not None and set(node.needs) != set(stage.inputs):
            raise WorkflowError(
                f"{self._at(name)}: it is given the inputs {sorted(node.needs)}, "
                f"but the stage takes {sorted(stage.inputs)}"
            )

    def _check_result(self, target: str, source: object) -> None:
        at = f"workflow {self.name!r}, result {target!r}"
        node, _, path = str(source).partition("/")
        if node not in self.stages:
            raise WorkflowError(
                f"{at}: it comes from an unknown node {node!r}; nodes are: {', '.join(self.stages)}"
            )
        if not (_is_inside(target) and _is_inside(path)):
            raise WorkflowError(
                f"{at}: write a name in the results folder and '<node>/<file in its output>', "
                f"not {source!r}"
            )
        if target in RESERVED:
            raise WorkflowError(f"{at}: {' and '.join(RESERVED)} are written by the runner itself")


def _is_inside(path: str) -> bool:
    parts = PurePosixPath(path).parts
    return bool(parts) and ".." not in parts and not PurePosixPath(path).is_absolute()


def _plain_config(mapping: DictConfig) -> dict[str, Any]:
    try:
        plain = OmegaConf.to_container(mapping, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise WorkflowError(f"the workflow's configuration: {error}") from error
    assert isinstance(plain, dict)
    return {str(key): value for key, value in plain.items()}


def _mapping(value: Any, at: str) -> dict[str, Any]:
    if value is None:  # `needs:` with nothing after it
        return {}
    if not isinstance(value, Mapping):
        raise WorkflowError(f"{at} must be a mapping, not {value!r}")
    return {str(key): item for key, item in value.items()}


def _known_keys(value: Any, schema: type, at: str) -> dict[str, Any]:
    entries = _mapping(value, at)
    valid = [entry.name for entry in fields(schema)]
    if unknown := sorted(set(entries) - set(valid)):
        raise WorkflowError(f"{at}: unknown keys {unknown}; valid ones: {', '.join(valid)}")
    return entries


def _explain(error: Exception, schema: DictConfig) -> str:
    """OmegaConf's message on one line, with the keys that are valid where one is not."""
    text = str(error).split("\n")[0]
    key = getattr(error, "full_key", None)
    if key:
        text = f"config key {key!r}: {text}"
    parent = getattr(error, "parent_node", None)
    if isinstance(error, KeyError) and isinstance(parent, DictConfig | dict):
        text += f"; valid keys: {', '.join(map(str, parent))}"
    elif not key:
        text = f"config: {text} (keys: {', '.join(map(str, schema))})"
    return text
