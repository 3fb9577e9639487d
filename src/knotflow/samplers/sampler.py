"""The interface between whatever proposes splines and whatever uses them.

A sampler is one file that registers a factory under a name, and one line of a workflow
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
from numpy.typing import NDArray

from knotflow.topology import Action

MODULES = {
    "aimed": "knotflow.samplers.aimed",
    "icp": "knotflow.samplers.icp",
    "primitives": "knotflow.samplers.primitives.library",
    "random": "knotflow.samplers.random",
}
"""Name of a sampler -> the module that registers it."""


class Sampler(Protocol):
    """Proposes splines; all that planning, evaluation and training know of a method.

    `sample` is enough. A method that can do more has further methods, which a search looks up with
    `ability` and does without where they are missing: those of `Foresight`, `Valuer`, `Judge` and
    `Arranger`.
    """

    def sample(
        self, points: NDArray, action: Action, count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Splines (count, 6) in range for a rope (V, 3) in a state that allows the action."""
        ...


class Foresight(Protocol):
    """Proposes splines whose ends are good to go on from."""

    def sample_onward(
        self, points: NDArray, action: Action, count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """As `Sampler.sample`, preferring ends that leave room for the actions that follow."""
        ...


class Valuer(Protocol):
    """Estimates how well an action can be done from a shape."""

    def values(
        self, points: NDArray, actions: Sequence[Action], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """(S,) probability that its best spline succeeds, for ropes (S, V, 3), an action each."""
        ...


class Judge(Protocol):
    """Estimates how well splines that others propose do an action."""

    def judged(self, points: NDArray, action: Action, splines: NDArray) -> NDArray[np.float64]:
        """(N,) probability that each of N splines (N, 6) succeeds on a rope (V, 3)."""
        ...


class Arranger(Protocol):
    """Makes room for an action by splines that keep the state."""

    def arrange(
        self, points: NDArray, action: Action, count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Splines (count, 6) that keep the state of a rope (V, 3) and make room for the action."""
        ...

    def arranged_values(
        self, points: NDArray, actions: Sequence[Action], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """(S,) expected value of each action after the best arranging spline; as `values`."""
        ...


def ability(sampler: Sampler, name: str) -> Callable[..., NDArray[np.float64]] | None:
    """An optional method of a sampler; None where it has none, or names it in its `lacks`.

    A sampler whose class has a method that this one cannot do, such as `values` without a critic,
    says so in an attribute `lacks`, a collection of such names. "undo" among them means that it
    does not know the action `Undo`.
    """
    if name in getattr(sampler, "lacks", ()):
        return None
    return getattr(sampler, name, None)


@dataclass
class SamplerConfig:
    """Which sampler, and its own settings."""

    name: str = "random"
    """A registered name."""
    settings: dict[str, Any] = field(default_factory=dict)
    """Fields of that sampler's configuration; others are refused."""

    def modules(self) -> tuple[str, ...]:
        """Dotted name of the module that the choice adds to a stage."""
        return (MODULES[self.name],) if self.name in MODULES else ()

    def inputs(self) -> tuple[str, ...]:
        """Names of the stage inputs without which the sampler cannot be built."""
        for module in self.modules():
            import_module(module)
        return _NEEDS.get(self.name, ())


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
    from omegaconf import OmegaConf  # here, as `knotflow plan` does without
    from omegaconf.errors import OmegaConfBaseException

    for module in MODULES.values():
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
