"""Stages: functions of a typed configuration and of the outputs of earlier stages.

    @stage("demonstrations")
    def simulate(config: SimulateConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
        for name in context.progress(context.pending(names, ".mcap")):
            with context.atomic(f"{name}.mcap") as path:
                ...

The versions of the packages that its file imports are part of a stage's signature: a package whose
behaviour changes raises its number in `knotflow.versions`, and older outputs are reproduced. Only
where the stage's own code changes its output does the stage get a higher `version`.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from .context import StageContext
from .dependencies import component_versions
from .errors import UnknownStageError

__all__ = ["STAGES", "Stage", "StageContext", "get_stage", "stage"]

StageFunction = Callable[[Any, Mapping[str, Path], StageContext], None]
Function = TypeVar("Function", bound=Callable[..., None])


@dataclass(frozen=True)
class Stage:
    """A registered stage."""

    name: str
    version: int
    function: StageFunction
    config_type: type
    """Dataclass of its configuration, usable as an OmegaConf structured config."""
    inputs: tuple[str, ...] | None = None
    """Names of the inputs it needs; None leaves it to the workflow."""

    @property
    def packages(self) -> dict[str, int]:
        """The packages it uses, with their versions."""
        return component_versions([self.function.__module__])


STAGES: dict[str, Stage] = {}


def stage(
    name: str, *, version: int = 1, inputs: Sequence[str] | None = None
) -> Callable[[Function], Function]:
    """Registers a function as a stage and returns it unchanged.

    Args:
        name: what workflows call it and what its output folder is called.
        version: to be raised when the stage's own code gives another output.
        inputs: if given, a workflow must connect exactly these inputs.

    Raises:
        ValueError: another function has this name, or the name is no plain folder name.
        TypeError: the function is not of (config, inputs, context), or its config no dataclass.
    """
    if not name.isidentifier():
        raise ValueError(f"a stage's name is its folder's name: letters, digits, _; not {name!r}")

    def register(function: Function) -> Function:
        known = STAGES.get(name)
        if known is not None and _place(known.function) != _place(function):
            raise ValueError(
                f"two stages are named {name!r}: {_place(known.function)} and {_place(function)}"
            )
        STAGES[name] = Stage(
            name, version, function, _config_type(function), None if inputs is None else (*inputs,)
        )
        return function

    return register


def get_stage(name: str) -> Stage:
    """The stage of this name.

    Raises:
        UnknownStageError: there is none; lists those there are.
    """
    if name not in STAGES:
        raise UnknownStageError(
            f"unknown stage {name!r}; stages are: {', '.join(sorted(STAGES)) or 'none yet'}"
        )
    return STAGES[name]


def _config_type(function: Callable[..., Any]) -> type:
    parameters = list(inspect.signature(function).parameters.values())
    if len(parameters) != 3:
        raise TypeError(f"{_place(function)} must take (config, inputs, context)")
    found = parameters[0].annotation
    if isinstance(found, str):  # from __future__ import annotations
        found = eval(found, function.__globals__)  # the stage's own source, as typing does
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise TypeError(
            f"{_place(function)}: annotate its first parameter with the dataclass of its "
            f"configuration, not {found!r}"
        )
    return found


def _place(function: Callable[..., Any]) -> str:
    return f"{function.__module__}.{function.__qualname__}"
