"""The interface of samplers, and their registry.

A sampler is a module that registers a factory under a name, and a line of a workflow
(`sampler: {name: mine}`) that chooses it:

    @sampler("mine")
    def build(config: MyConfig, inputs: Mapping[str, Path]) -> Sampler: ...

`inputs` are the outputs of earlier stages by name, such as "demonstrations".
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, TypeVar, get_type_hints

import numpy as np

from knotflow.topology import Action
from knotflow.topology.polyline import Floats

MODULES = {
    "aimed": "knotflow.samplers.demonstrations.heuristic",
    "icp": "knotflow.samplers.icp",
    "primitives": "knotflow.samplers.primitives.library",
    "random": "knotflow.samplers.random",
}
"""Name of a sampler -> the module that registers it."""


class Sampler(Protocol):
    """Proposes splines; all that planning, evaluation and training know of a method.

    Only `sample` is required. The optional methods are those of the protocols below; `capability`
    finds them.
    """

    def sample(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """Splines (count, 6) in range for a rope (V, 3) in a state that allows the action."""
        ...


class NextValueSampler(Protocol):
    """Proposes splines that count the value of the next state."""

    def sample_for_next(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """As `Sampler.sample`, for success times the value of the shape that results."""
        ...


class ValueEstimator(Protocol):
    """Estimates the value of shapes."""

    def values(self, points: Floats, actions: Sequence[Action], rng: np.random.Generator) -> Floats:
        """(S,) success probability of the best spline, for ropes (S, V, 3) with an action each."""
        ...


class SuccessEstimator(Protocol):
    """Estimates the success of given splines."""

    def success_probability(self, points: Floats, action: Action, splines: Floats) -> Floats:
        """(N,) probability that each of N splines (N, 6) succeeds on a rope (V, 3)."""
        ...


class ArrangingSampler(Protocol):
    """Proposes splines that keep the state and make an action easier."""

    def arrange(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """Splines (count, 6) that keep the state of a rope (V, 3), before the action."""
        ...

    def arranged_values(
        self, points: Floats, actions: Sequence[Action], rng: np.random.Generator
    ) -> Floats:
        """(S,) expected value of each action after the best arranging spline; as `values`."""
        ...


def has_capability(sampler: Sampler, name: str) -> bool:
    """Whether a sampler has an optional method, or knows `Undo` actions ("undo").

    A sampler whose instances differ names theirs in an attribute `capabilities`; any other has
    those that its class defines, and knows `Undo`.
    """
    capabilities = getattr(sampler, "capabilities", None)
    if capabilities is not None:
        return name in capabilities
    return name == "undo" or hasattr(sampler, name)


def capability(sampler: Sampler, name: str) -> Callable[..., Floats] | None:
    """An optional method of a sampler, None where it has none."""
    return getattr(sampler, name) if has_capability(sampler, name) else None


@dataclass
class SamplerConfig:
    """Which sampler, and its settings."""

    name: str = "random"
    """A registered name."""
    settings: dict[str, Any] = field(default_factory=dict)
    """Fields of that sampler's configuration."""

    def modules(self) -> tuple[str, ...]:
        """Dotted names of the modules that the choice adds to a stage.

        Raises:
            ValueError: the name is unknown.
        """
        return (sampler_module(self.name),)

    def inputs(self) -> tuple[str, ...]:
        """Names of the stage inputs without which the sampler cannot be built."""
        for module in self.modules():
            import_module(module)
        return _REQUIRED_INPUTS[self.name]


Factory = Callable[[Any, Mapping[str, Path]], Sampler]
Function = TypeVar("Function", bound=Callable[..., Any])
_FACTORIES: dict[str, Factory] = {}
_REQUIRED_INPUTS: dict[str, tuple[str, ...]] = {}


def sampler(name: str, needs: tuple[str, ...] = ()) -> Callable[[Function], Function]:
    """Register a factory `(config, inputs) -> Sampler`; its config type is its annotation.

    `needs` are the inputs without which it cannot be made.
    """

    def register(factory: Function) -> Function:
        _FACTORIES[name], _REQUIRED_INPUTS[name] = factory, needs
        return factory

    return register


def sampler_module(name: str) -> str:
    """Dotted name of the module that defines a sampler; imports nothing.

    Raises:
        ValueError: the name is unknown; names the valid ones.
    """
    if name in MODULES:
        return MODULES[name]
    if name in _FACTORIES:
        return _FACTORIES[name].__module__
    raise ValueError(
        f"unknown sampler {name!r}; valid are {', '.join(sorted({*MODULES, *_FACTORIES}))}"
    )


def build_sampler(config: SamplerConfig, inputs: Mapping[str, Path]) -> Sampler:
    """The sampler that a configuration names.

    Raises:
        ValueError: for an unknown name, one whose inputs are missing, or unknown settings, naming
            the valid ones.
    """
    from omegaconf import OmegaConf  # slow to import
    from omegaconf.errors import OmegaConfBaseException

    import_module(sampler_module(config.name))
    if missing := sorted(set(_REQUIRED_INPUTS[config.name]) - set(inputs)):
        for module in MODULES.values():
            import_module(module)
        usable = [name for name, needs in _REQUIRED_INPUTS.items() if set(needs) <= set(inputs)]
        raise ValueError(
            f"the sampler {config.name!r} needs the output of the stage {', '.join(missing)}, "
            f"which is no input here; without it there are {', '.join(sorted(usable))}"
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
