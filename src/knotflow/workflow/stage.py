"""Stages: functions of typed keyword arguments and of the outputs of other stages.

    @stage
    def evaluation(run: StageRun, *, starts: Path, sampler: SamplerConfig, trials: int) -> None:
        for name in run.pending(names, ".npz"):
            with run.atomic(f"{name}.npz") as path:
                ...

A parameter of type `Path` is an input: the output folder of another stage, or a file or folder of
the user's. `Path | None` is one that may be absent, `Mapping[str, Path]` several by name. All other
parameters are arguments; their types are those of an OmegaConf structured config. A value with a
method `modules()` names modules that it will load, whose versions then count; one with a method
`inputs()` names the optional inputs that it needs. Where a text names a file, its contents count.
"""

from __future__ import annotations

import copy
import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from os.path import isfile
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from knotflow.workflow.dependencies import (
    component_versions,
    file_digests,
    library_versions,
    stage_code,
)
from knotflow.workflow.key import digest, plain

Function = TypeVar("Function", bound=Callable[..., None])
OPTIONAL, SEVERAL = Path | None, Mapping[str, Path]


class WorkflowError(ValueError):
    """A workflow that cannot be run as it is described."""


@dataclass(frozen=True)
class Stage:
    """A registered stage."""

    function: Callable[..., None]

    @property
    def name(self) -> str:
        """What workflows call it, and the name of its outputs' folder."""
        return self.function.__name__

    @cached_property
    def types(self) -> dict[str, Any]:
        """Type of every keyword parameter, by name."""
        hints = get_type_hints(self.function)
        _, *parameters = inspect.signature(self.function).parameters.values()
        return {one.name: hints[one.name] for one in parameters}

    @cached_property
    def inputs(self) -> dict[str, Any]:
        """The parameters that are inputs, with their types."""
        return {
            name: kind for name, kind in self.types.items() if kind in (Path, OPTIONAL, SEVERAL)
        }

    @cached_property
    def _schema(self) -> type:
        parameters = inspect.signature(self.function).parameters
        fields: list[Any] = []
        for name in self.arguments:
            kind, default = self.types[name], parameters[name].default
            if default is inspect.Parameter.empty:
                fields.append((name, kind))
            else:
                factory = partial(copy.deepcopy, default)
                fields.append((name, kind, dataclasses.field(default_factory=factory)))
        return dataclasses.make_dataclass(self.name, fields, kw_only=True)

    @cached_property
    def _bound(self) -> dict[str, Any]:
        """What was bound, by its values: nodes of a matrix, and experiments, share most of it."""
        return {}

    @property
    def arguments(self) -> list[str]:
        """The parameters that are not inputs."""
        return [name for name in self.types if name not in self.inputs]

    def bind(self, values: Mapping[str, list[Any]]) -> dict[str, Any]:
        """Typed arguments, of each its `values` merged one over the other; none leaves the default.

        Raises:
            WorkflowError: a value is missing, of the wrong type, or has an unknown key.
        """
        if (asked := repr(values)) not in self._bound:
            layers = [{name: one} for name, several in values.items() for one in several]
            try:
                merged = OmegaConf.merge(OmegaConf.structured(self._schema), *layers)
                self._bound[asked] = OmegaConf.to_object(merged)
            except (OmegaConfBaseException, TypeError, ValueError) as error:
                raise WorkflowError(_explain(error)) from error
        bound = copy.deepcopy(self._bound[asked])
        return {name: getattr(bound, name) for name in self.arguments}

    def identity(self, arguments: Mapping[str, Any], inputs: Mapping[str, Any]) -> dict[str, Any]:
        """All that decides an output, as plain data; its hash is the output's key.

        `inputs` are the key or digest of each input that is there; of several, by name.
        """
        loaded = {name for value in arguments.values() for name in named_by(value, "modules")}
        code = stage_code(self.function)
        modules = code.modules | loaded
        values = plain(arguments)
        files = {one: digest(Path(one)) for one in sorted({*_words(values)}) if isfile(one)}
        return {
            "stage": self.name,
            "arguments": values,
            "inputs": plain(inputs),
            "code": code.digest,
            "components": {**component_versions(modules), **file_digests(loaded)},
            "libraries": library_versions(modules),
            **({"files": files} if files else {}),
        }


STAGES: dict[str, Stage] = {}


def stage(function: Function) -> Function:
    """Register a function as a stage, and return it unchanged.

    Raises:
        ValueError: another function has this name.
    """
    known = STAGES.get(function.__name__)
    if known is not None and known.function.__module__ != function.__module__:
        raise ValueError(
            f"two stages are called {function.__name__!r}: in {known.function.__module__} and "
            f"{function.__module__}"
        )
    STAGES[function.__name__] = Stage(function)
    return function


def get_stage(name: str) -> Stage:
    """The stage of this name.

    Raises:
        WorkflowError: there is none; lists those there are.
    """
    if name not in STAGES:
        raise WorkflowError(f"unknown stage {name!r}; there are {', '.join(sorted(STAGES))}")
    return STAGES[name]


def named_by(value: Any, method: str) -> tuple[str, ...]:
    """The modules that an argument's value loads (`modules`), the inputs it needs (`inputs`)."""
    named = getattr(value, method, None)
    return tuple(named()) if callable(named) else ()


def _words(value: Any) -> Iterator[str]:
    """All texts in plain data, of which some may name a file."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | dict):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _words(one)


def _explain(error: Exception) -> str:
    """OmegaConf's message on one line, with the keys that are valid where one is not."""
    text = str(error).split("\n")[0]
    key, parent = getattr(error, "full_key", None), getattr(error, "parent_node", None)
    if key and key not in text:
        text = f"{key}: {text}"
    if isinstance(error, KeyError | OmegaConfBaseException) and isinstance(parent, Mapping):
        text += f" (keys: {', '.join(map(str, parent))})"
    return text
