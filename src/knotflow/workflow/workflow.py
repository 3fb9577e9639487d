"""A workflow: which stages, what feeds what, and which of their files are the results.

    name: ablation_actor_critic
    caption: Actor and critic together against either alone (Sec. VII-B1, Fig. 7)
    matrix:
      variant: {actor_only: {primitive: {variant: actor_only}}, actor_critic: {}}
      training_seed: [10, 11, 12]
    stages:
      demonstrations:
      imitation: {matrix: [variant, training_seed]}
      evaluation: {matrix: [variant, training_seed], primitives: imitation, sampler: primitives}
      rates: {stage: success_rates, evaluations: evaluation}
    results:
      success_rates.csv: rates

A node is called like its stage unless it says otherwise, and lists deviations only. Its inputs are
the nodes of the same names, or those it names, or a path of the root configuration; one that may
be absent is there if the node names it or an argument asks for it (`inputs()`). Along an axis
of the matrix there is a node for each value; axes that two nodes share are matched, and a node
without an axis gets all nodes along it by name. An argument takes, each merged over the one before:
the stage's default, the root configuration's value of that name, that in the section of the
stage's name, the node's own, that in the section of the node's name; and where the stage has no
section, that in the section of the experiment's name.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import yaml

from knotflow.workflow.key import digest, key_of
from knotflow.workflow.stage import OPTIONAL, SEVERAL, Stage, WorkflowError, get_stage, named_by
from knotflow.workflow.store import StageFolder

Source = str | Path
"""Where an input comes from: the node of that name or a path of the user's."""


@dataclass(frozen=True)
class Node:
    """One use of a stage, with everything bound."""

    name: str
    stage: Stage
    caption: str
    arguments: Mapping[str, Any]
    inputs: Mapping[str, Source | Mapping[str, str]]

    def needs(self) -> set[str]:
        """Names of the nodes it depends on."""
        found: list[Source] = []
        self.each_input(found.append)
        return {source for source in found if isinstance(source, str)}

    def each_input(self, of: Callable[[Source], Any]) -> dict[str, Any]:
        """What `of` makes of each input's source; of several, by name."""
        return {
            name: {one: of(node) for one, node in source.items()}
            if isinstance(source, Mapping)
            else of(source)
            for name, source in self.inputs.items()
        }


@dataclass(frozen=True)
class Workflow:
    """The nodes that the results need, in the order in which they run."""

    name: str
    caption: str
    nodes: Mapping[str, Node]
    results: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """File or folder in results/<experiment>/ -> node, and the path in its output."""
    ships: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """The same of what the package ships, by its path in the package; not copied."""

    @cached_property
    def identities(self) -> dict[str, dict[str, Any]]:
        """What decides each node's output, see `Stage.identity`."""
        found: dict[str, dict[str, Any]] = {}

        def identity(source: Source) -> Any:
            if isinstance(source, Path):
                return {"contents": digest(source)}
            return key_of(found[source])

        for name, node in self.nodes.items():
            found[name] = node.stage.identity(node.arguments, node.each_input(identity))
        return found

    @cached_property
    def keys(self) -> dict[str, str]:
        """The key of each node's output."""
        return {name: key_of(identity) for name, identity in self.identities.items()}

    def folder(self, name: str, results_dir: Path) -> StageFolder:
        """The place of a node's output."""
        return StageFolder(results_dir, self.nodes[name].stage.name, self.keys[name])


def read_workflow(root: Mapping[str, Any], groups: Path) -> Workflow:
    """The workflow of a resolved root configuration, plain data as at the top of this file.

    An argument that is named by a word, such as `planner: paper`, is read from `groups`, here
    groups/planner/paper.yaml.

    Raises:
        WorkflowError: an unknown stage, node, axis or argument; a missing or wrong value; a cycle;
            a result that no node makes. The message names the node, and what would be right.
    """
    return _Reader(root, groups).read()


class _Reader:
    def __init__(self, root: Mapping[str, Any], groups: Path) -> None:
        self.root, self.groups = root, groups
        given = dict(root.get("workflow") or {})
        unknown = given.keys() - {"name", "caption", "matrix", "stages", "results", "ships"}
        if unknown or not given.get("name") or not given.get("stages"):
            raise WorkflowError(
                "a workflow has name, caption, matrix, stages, results and ships"
                + (f", not {', '.join(sorted(unknown))}" if unknown else "")
            )
        self.name, self.caption = given["name"], given.get("caption") or ""
        self.results, self.ships = given.get("results") or {}, given.get("ships") or {}
        self.axes = {
            axis: {str(one): {axis: one} for one in values} if isinstance(values, list) else values
            for axis, values in (given.get("matrix") or {}).items()
        }
        self.entries = {name: dict(entry or {}) for name, entry in given["stages"].items()}
        self.axes_of = {name: tuple(one.pop("matrix", ())) for name, one in self.entries.items()}
        self.stages = {
            name: get_stage(entry.pop("stage", name)) for name, entry in self.entries.items()
        }

    def read(self) -> Workflow:
        """Expand and bind everything."""
        nodes: dict[str, Node] = {}
        for base in self.entries:
            unknown = [axis for axis in self.axes_of[base] if axis not in self.axes]
            if unknown:
                raise self._error(base, f"no axis {unknown[0]!r}; axes: {', '.join(self.axes)}")
            for variant in itertools.product(*(self.axes[axis] for axis in self.axes_of[base])):
                node = self._node(base, dict(zip(self.axes_of[base], variant, strict=True)))
                nodes[node.name] = node
        self._check_axes()
        needs = {name: node.needs() for name, node in nodes.items()}
        for name, named in needs.items():
            if absent := named - {*nodes}:
                base = min(absent).partition("[")[0]
                known = ", ".join(one for one in nodes if one.partition("[")[0] == base)
                raise self._error(name, f"no node {min(absent)!r}; there are {known}")
        try:
            order = list(TopologicalSorter(needs).static_order())
        except CycleError as error:
            cycle = " -> ".join(reversed(error.args[1]))
            raise WorkflowError(f"workflow {self.name!r}: a cycle, {cycle}") from None
        results, ships = self._results(self.results, nodes), self._results(self.ships, nodes)
        wanted = {node for node, _ in (*results.values(), *ships.values())} or {*nodes}
        for name in reversed(order):
            if name in wanted:
                wanted |= needs[name]
        kept = {name: nodes[name] for name in order if name in wanted}
        return Workflow(self.name, self.caption, kept, results, ships)

    def _node(self, base: str, variant: Mapping[str, str]) -> Node:
        stage, entry = self.stages[base], dict(self.entries[base])
        caption = entry.pop("caption", "") or ""
        own: dict[str, Any] = {}
        for axis, value in variant.items():
            deviations = self.axes[axis][value] or {}
            own |= {name: one for name, one in deviations.items() if name in stage.types}
        own |= entry
        if unknown := own.keys() - stage.types.keys():
            raise self._error(
                base, f"no parameter {sorted(unknown)[0]!r}; it has {', '.join(stage.types)}"
            )
        name = _variant_name(base, variant.values())
        layers = {
            argument: self._layers(base, stage, argument, own) for argument in stage.arguments
        }
        try:
            arguments = stage.bind(layers)
        except WorkflowError as error:
            raise self._error(name, str(error)) from error
        asked = {
            one: argument
            for argument, value in arguments.items()
            for one in named_by(value, "inputs")
        }
        optional = [one for one, kind in stage.inputs.items() if kind == OPTIONAL]
        if optional and (lacking := sorted(asked.keys() - stage.inputs.keys())):
            which = asked[lacking[0]]
            raise self._error(
                name,
                f"its {which} needs {lacking[0]}, but the stage {stage.name!r} takes only "
                f"{', '.join(optional)}: choose another {which}",
            )
        inputs = {
            parameter: self._input(base, parameter, kind, own, variant)
            for parameter, kind in stage.inputs.items()
            if kind != OPTIONAL or parameter in own or parameter in asked
        }
        return Node(name, stage, caption, arguments, inputs)

    def _layers(self, base: str, stage: Stage, argument: str, own: Mapping[str, Any]) -> list[Any]:
        """The values of an argument, to be merged one over the other."""

        def section(name: str) -> list[Any]:
            values = self.root.get(name)
            found = isinstance(values, Mapping) and argument in values
            return [values[argument]] if found else []  # type: ignore[index]

        structured = hasattr(stage.types[argument], "__dataclass_fields__")
        layers = []
        if argument in self.root and structured == isinstance(self.root[argument], Mapping):
            layers.append(self.root[argument])
        of_stage, of_node = section(stage.name), section(base) if base != stage.name else []
        layers += [*of_stage, *([own[argument]] if argument in own else []), *of_node]
        if not of_stage and not of_node:
            layers += section(self.name)
        if not structured:
            return layers[-1:]
        for index, layer in enumerate(layers):
            if isinstance(layer, str):  # the name of an option replaces what was before
                layers[: index + 1] = [{}] * index + [self._option(base, argument, layer)]
        return layers or [{}]

    def _option(self, base: str, group: str, name: str) -> Any:
        file = self.groups / group / f"{name}.yaml"
        if not file.is_file():
            known = sorted(one.stem for one in file.parent.glob("*.yaml"))
            raise self._error(base, f"no {group} {name!r}; there are {', '.join(known)}")
        return yaml.safe_load(file.read_text("utf-8")) or {}

    def _input(
        self,
        base: str,
        parameter: str,
        kind: Any,
        own: Mapping[str, Any],
        variant: Mapping[str, str],
    ) -> Source | Mapping[str, str]:
        given = own.get(parameter, parameter if parameter in self.entries else None)
        if kind == SEVERAL:
            if isinstance(given, str):
                return self._all_of(base, given, variant)
            names = given if isinstance(given, Mapping) else {one: one for one in given or ()}
            return {name: self._one_of(base, node, variant) for name, node in names.items()}
        if given is not None:
            return self._one_of(base, str(given), variant)
        if isinstance(path := self.root.get(parameter), str):
            if not Path(path).exists():
                raise self._error(base, f"{parameter}={path}: there is no such file or folder")
            return Path(path)
        known = ", ".join(self.entries)
        raise self._error(base, f"its input {parameter!r} is missing; nodes are: {known}")

    def _one_of(self, base: str, node: str, variant: Mapping[str, str]) -> str:
        """A node by its name, or that variant of it which shares all axes."""
        node, named, values = node.partition("[")
        self._check_node(base, node)
        if named:
            return _variant_name(node, values.rstrip("]").split("."))
        axes = self.axes_of[node]
        if missing := [axis for axis in axes if axis not in variant]:
            raise self._error(
                base, f"{node!r} is made along {missing[0]!r}: name one, {node}[...], or vary too"
            )
        return _variant_name(node, [variant[axis] for axis in axes])

    def _all_of(self, base: str, node: str, variant: Mapping[str, str]) -> dict[str, str]:
        """All variants of a node along axes that are not shared, by the values on these."""
        self._check_node(base, node)
        free = [axis for axis in self.axes_of[node] if axis not in variant]
        found = {}
        for values in itertools.product(*(self.axes[axis] for axis in free)):
            chosen = {**variant, **dict(zip(free, values, strict=True))}
            found[".".join(values) or node] = self._one_of(base, node, chosen)
        return found

    def _check_node(self, base: str, node: str) -> None:
        if node not in self.entries:
            raise self._error(base, f"no node {node!r}; nodes are: {', '.join(self.entries)}")

    def _check_axes(self) -> None:
        """Refuse deviations along an axis that no stage takes."""
        for axis, values in self.axes.items():
            bases = [base for base in self.entries if axis in self.axes_of[base]]
            taken = {name for base in bases for name in self.stages[base].types}
            for deviations in values.values():
                if unknown := (deviations or {}).keys() - taken:
                    raise WorkflowError(
                        f"workflow {self.name!r}, axis {axis!r}: no stage along it takes "
                        f"{sorted(unknown)[0]!r}"
                    )

    def _results(
        self, given: Mapping[str, str], nodes: Mapping[str, Node]
    ) -> dict[str, tuple[str, str]]:
        """File -> node and path in its output, the same file where only a node is named."""
        found = {}
        for target, source in given.items():
            node, _, path = str(source).partition("/")
            if node not in nodes:
                raise WorkflowError(
                    f"workflow {self.name!r}, result {target!r}: no node {node!r}; nodes are: "
                    f"{', '.join(nodes)}"
                )
            if ".." in Path(target).parts or Path(target).is_absolute() or ".." in path:
                raise WorkflowError(f"workflow {self.name!r}: {target!r} is outside of the results")
            found[target] = (node, path or target)
        return found

    def _error(self, node: str, text: str) -> WorkflowError:
        return WorkflowError(f"workflow {self.name!r}, node {node!r}: {text}")


def _variant_name(base: str, values: Any) -> str:
    label = ".".join(map(str, values))
    return f"{base}[{label}]" if label else base
