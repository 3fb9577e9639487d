"""The interface between whatever proposes splines and whatever uses them.

A sampler is one file that registers a factory under a name, and one line of a workflow
(`sampler: {name: mine}`) that chooses it:

    @sampler("mine")
    def build(config: MyConfig, inputs: Mapping[str, Path]) -> Sampler: ...

`inputs` are the outputs of earlier stages by name, such as "demonstrations".
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from knotflow.topology import Action

MODULES = ("knotflow.baselines", "knotflow.primitives.library")
"""Those whose import registers samplers."""


class Sampler(Protocol):
    """Proposes splines; all that planning, evaluation and training know of a method."""

    def sample(
        self, points: NDArray, action: Action, count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Splines (count, 6) in range for a rope (V, 3) in a state that allows the action."""
        ...


@dataclass
class SamplerConfig:
    """Which sampler, and its own settings."""

    name: str = "random"
    """A registered name."""
    settings: dict[str, Any] = field(default_factory=dict)
    """Fields of that sampler's configuration; others are refused."""


Factory = Callable[[Any, Mapping[str, Path]], Sampler]
Function = TypeVar("Function", bound=Callable[..., Any])
_FACTORIES: dict[str, Factory] = {}
_NEEDS: dict[str, tuple[str, ...]] = {}


def sampler(name: str, needs: tuple[str, ...] = ()) -> Callable[[Function], Function]:
    """Register a factory `(config, inputs) -> Sampler`; its config type is its annotation.

    `needs` are the inputs without which it cannot be made.
    """

    def register(factory: Function) -> Function:
        _FACTORIES[name], _NEEDS[name] = factory, needs
        return factory

    return register


def build_sampler(config: SamplerConfig, inputs: Mapping[str, Path]) -> Sampler:
    """The sampler that a configuration names.

    Raises:
        ValueError: for an unknown name, one whose inputs are missing, or unknown settings, naming
            the valid ones.
    """
    for module in MODULES:
        import_module(module)
    usable = ", ".join(sorted(name for name in _FACTORIES if set(_NEEDS[name]) <= set(inputs)))
    if config.name not in _FACTORIES:
        raise ValueError(f"unknown sampler {config.name!r}; here there are {usable}")
    if missing := sorted(set(_NEEDS[config.name]) - set(inputs)):
        raise ValueError(
            f"the sampler {config.name!r} needs the output of the stage {', '.join(missing)}, "
            f"which is no input here; without it there are {usable}"
        )
    factory = _FACTORIES[config.name]
    first = next(iter(inspect.signature(factory).parameters))
    schema = OmegaConf.structured(get_type_hints(factory)[first])
    try:
        settings = OmegaConf.to_object(OmegaConf.merge(schema, config.settings))
    except OmegaConfBaseException as error:
        what = str(error).splitlines()[0]
        raise ValueError(
            f"sampler {config.name!r}: {what}; it knows {', '.join(schema) or 'no settings'}"
        ) from None
    return factory(settings, inputs)
