"""The interface of samplers, and their registry.

A sampler is a module that registers a factory under a name, and a line of a workflow
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

from knotflow.topology import Action
from knotflow.topology.polyline import Floats

MODULES = {
    "aimed": "knotflow.samplers.demonstrations.heuristic",
    "icp": "knotflow.samplers.icp",
    "primitives": "knotflow.samplers.primitives.library",
    "random": "knotflow.samplers.random",
}
"""The modules that register samplers, by name."""


class Sampler(Protocol):
    """Proposes splines; only `sample` is required.

    `capability` finds the optional methods, for a rope (V, 3) or ropes (S, V, 3) with an action
    each:

    * `sample_for_next(points, action, count, rng)`: as `sample`, for success times the value of the
      shape that results;
    * `success_probability(points, action, splines)`: (N,) of splines (N, 6);
    * `values(points, actions, rng)`: (S,) success probability of the best spline on each rope;
    * `arrange(points, action, count, rng)`: splines that keep the state and make an action easier;
    * `arranged_values(points, actions, rng)`: (S,) as `values`, after the best arranging spline.

    A sampler that has `for_rope(rope)` is asked for one that knows what rope the shapes are of.
    """

    def sample(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """Splines (count, 6) in range for a rope (V, 3) in a state that allows the action."""
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
    """Fields of its configuration."""

    def modules(self) -> tuple[str, ...]:
        """Dotted names of the modules that the choice adds to a stage.

        Raises:
            ValueError: the name is unknown.
        """
        if self.name in MODULES:
            return (MODULES[self.name],)
        if self.name in _FACTORIES:
            return (_FACTORIES[self.name].__module__,)
        names = ", ".join(sorted({*MODULES, *_FACTORIES}))
        raise ValueError(f"unknown sampler {self.name!r}; valid are {names}")

    def inputs(self) -> tuple[str, ...]:
        """Names of the stage inputs without which the sampler cannot be built.

        Raises:
            ValueError: the module does not register the name; see `modules`, too.
        """
        for module in self.modules():
            import_module(module)
            if self.name not in _FACTORIES:
                raise ValueError(f"{module} registers no @sampler({self.name!r})")
        return _REQUIRED_INPUTS[self.name]


@dataclass
class NoSettings:
    """The configuration of a sampler without settings."""


Factory = Callable[[Any, Mapping[str, Path]], Sampler]
Function = TypeVar("Function", bound=Callable[..., Any])
_FACTORIES: dict[str, Factory] = {}
_REQUIRED_INPUTS: dict[str, tuple[str, ...]] = {}


def sampler(name: str, needs: tuple[str, ...] = ()) -> Callable[[Function], Function]:
    """Register a factory, which requires the inputs `needs`; its config type is its annotation."""

    def register(factory: Function) -> Function:
        _FACTORIES[name], _REQUIRED_INPUTS[name] = factory, needs
        return factory

    return register


def build_sampler(config: SamplerConfig, inputs: Mapping[str, Path]) -> Sampler:
    """The sampler that a configuration names.

    Raises:
        ValueError: an unknown name, missing inputs or unknown settings; names the valid ones.
    """
    from omegaconf import OmegaConf  # slow to import
    from omegaconf.errors import OmegaConfBaseException

    if missing := sorted(set(config.inputs()) - set(inputs)):
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
