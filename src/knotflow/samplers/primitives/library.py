"""The library of topological motion primitives: one sampler for every action (Sec. V).

A library is one safetensors file: the networks' weights, and as metadata the format's version, the
configuration, the actions each primitive was trained on, the rope, and a digest of the weights.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from knotflow.arrays import read_weights, save_weights
from knotflow.samplers.primitives.canonical import ALL_PRIMITIVES, ARRANGE, UNDO, canonicalise
from knotflow.samplers.primitives.config import CemConfig, NetworkConfig, PrimitiveConfig
from knotflow.samplers.primitives.encoding import Encoded, encode_canonical
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.samplers.sampler import NoSettings, sampler
from knotflow.simulation import ProportionsConfig, RopeConfig
from knotflow.threads import one_thread
from knotflow.topology import Action, parse_action
from knotflow.topology.polyline import Floats

FORMAT = "knotflow primitives"
VERSION = "4"
"""Raised when the encoding or the networks change, so that older weights mean something else."""
_TOLERANCE = 1.1  # factor on a rope's proportions up to which it is like another
FILE = "primitives.safetensors"
"""A library's name in the output of a stage."""


class LibraryError(ValueError):
    """A file that is no library of primitives, or not one that can be used here."""


class UnlikeRopeWarning(UserWarning):
    """A rope that differs from the one that the primitives were trained with."""


class PrimitiveLibrary:
    """Primitives and the actions they were trained on; a sampler, on one thread of PyTorch."""

    def __init__(
        self,
        primitives: Mapping[int, Primitive],
        trained_on: Mapping[int, Sequence[Action]],
        rope: RopeConfig,
        next_values: bool = False,
        proportions: ProportionsConfig | None = None,
    ) -> None:
        """Primitives by number, the actions each was trained on, the rope, whether critics have
        learned the value of the next action (Sec. V-B c), and of which ropes beside that one."""
        if not primitives or not set(primitives) == set(trained_on) <= set(ALL_PRIMITIVES):
            raise ValueError(
                f"a library has primitives out of {ALL_PRIMITIVES} and trained actions for each, "
                f"got {sorted(primitives)} and {sorted(trained_on)}"
            )
        self.primitives = {number: primitives[number].eval() for number in sorted(primitives)}
        self.trained_on = {number: tuple(trained_on[number]) for number in sorted(trained_on)}
        self.rope, self.next_values, self.proportions = rope, next_values, proportions
        self._acts_on = rope

    @classmethod
    def merged(cls, libraries: Iterable[PrimitiveLibrary]) -> PrimitiveLibrary:
        """The primitives of several libraries for one rope as one.

        Raises:
            ValueError: two have the same primitive, or another rope.
        """
        first, *others = libraries
        primitives, trained_on = dict(first.primitives), dict(first.trained_on)
        next_values = any(one.next_values for one in (first, *others))
        for one in others:
            why = f"ropes {first.rope} and {one.rope}" if one.rope != first.rope else ""
            if doubled := set(primitives) & set(one.primitives):
                why = f"primitives {sorted(doubled)} are in two of them"
            if why:
                raise ValueError(f"libraries cannot be merged: {why}")
            primitives |= one.primitives
            trained_on |= one.trained_on
        return cls(primitives, trained_on, first.rope, next_values, first.proportions)

    def for_rope(self, rope: RopeConfig) -> PrimitiveLibrary:
        """The same primitives, told that shapes are those of another rope.

        Warns (`UnlikeRopeWarning`) of one that is unlike those trained with.
        """
        other = copy(self)
        other._acts_on = rope
        if unlike := [*self._unlike(rope)]:
            warnings.warn(
                f"the rope is out of the primitives' range: {', '.join(unlike)}; expect more "
                "splines, or none that succeeds",
                UnlikeRopeWarning,
                stacklevel=3,
            )
        return other

    def _unlike(self, rope: RopeConfig) -> Iterator[str]:
        ours, among = self.rope, self.proportions
        thick, bending = 2 * ours.radius / ours.length, ours.bending_length / ours.length
        for name, unit, now, low, high in (
            ("length", " m", rope.length, ours.length, ours.length),
            (
                *("diameter", " lengths", 2 * rope.radius / rope.length),
                *((among.thinnest, among.thickest) if among else (thick, thick)),
            ),
            (
                *("bending length", " lengths", rope.bending_length / rope.length),
                *((among.softest, among.stiffest) if among else (bending, bending)),
            ),
        ):
            if not low / _TOLERANCE <= now <= high * _TOLERANCE:
                trained = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
                yield f"{name} {now:.3g}{unit} (trained with {trained}{unit})"

    def sample(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """Splines (count, 6) in range for a rope (V, 3), each from a search of its own.

        Mirroring (or reversing) rope and action mirrors (or keeps) the proposals.

        Raises:
            ValueError: there is no primitive for the action in this library.
            IllegalActionError: the action names a segment that the rope does not have.
        """
        return self.propose(points[None], [action], count, rng).squeeze(0)

    def sample_for_next(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """As `sample`, for success times the value of the next state."""
        return self.propose(points[None], [action], count, rng, use_next_value=True).squeeze(0)

    def arrange(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """As `sample`, for splines that keep the state and make an action easier."""
        return self.propose(points[None], [action], count, rng, True, arranging=True).squeeze(0)

    @property
    def capabilities(self) -> frozenset[str]:
        """Optional methods that this library has networks for, see `samplers.sampler`."""
        known = {"values", "success_probability", "sample_for_next", "arrange", "arranged_values"}
        if any(primitive.critic is None for primitive in self.primitives.values()):
            known -= {"values", "success_probability"}
        if not self.next_values:
            known -= {"sample_for_next"}
        if ARRANGE not in self.primitives:
            known -= {"arrange", "arranged_values"}
        return frozenset(known | ({"undo"} if UNDO in self.primitives else set()))

    @one_thread()
    def propose(
        self,
        points: Floats,
        actions: Sequence[Action],
        count: int,
        rng: np.random.Generator,
        use_next_value: bool = False,
        arranging: bool = False,
    ) -> Floats:
        """Splines (S, count, 6) for ropes (S, V, 3) with an action each, or to arrange for it.

        With `use_next_value` they are searched for success times the value of the next state.
        """
        out = np.empty((len(actions), count, 6))
        for number, rows, encoded in self._encoded(points, actions, arranging):
            found = self.primitives[number].search(encoded, count, rng, use_next_value)
            out[rows] = encoded.frames.to_world(found.numpy())
        return out

    @one_thread()
    def success_probability(self, points: Floats, action: Action, splines: Floats) -> Floats:
        """The critic's probability (N,) that splines (N, 6) do an action on a rope (V, 3).

        Raises:
            ValueError: the primitive has no critic, or there is none for the action.
        """
        ((number, _, encoded),) = self._encoded(points[None], [action], arranging=False)
        return self.primitives[number].success_probability(encoded, splines[None]).squeeze(0)

    @one_thread()
    def values(
        self,
        points: Floats,
        actions: Sequence[Action],
        rng: np.random.Generator,
        use_next_value: bool = False,
        arranging: bool = False,
    ) -> Floats:
        """Max Q (S,) of ropes (S, V, 3) with an action each (Sec. V-B c); see `propose`.

        Raises:
            ValueError: a primitive has no critic, or there is none for an action.
        """
        out = np.empty(len(actions))
        for number, rows, encoded in self._encoded(points, actions, arranging):
            primitive = self.primitives[number]
            noise = primitive.value_noise(len(rows), rng)
            out[rows] = primitive.values(encoded.inputs, noise, use_next_value).numpy()
        return out

    def arranged_values(
        self, points: Floats, actions: Sequence[Action], rng: np.random.Generator
    ) -> Floats:
        """Value (S,) of each action once its rope (S, V, 3) is arranged for it by one spline."""
        return self.values(points, actions, rng, use_next_value=True, arranging=True)

    def _encoded(
        self, points: Floats, actions: Sequence[Action], arranging: bool
    ) -> Iterator[tuple[int, NDArray[np.intp], Encoded]]:
        """Ropes with an action each, encoded for the primitives that serve them."""
        ropes = [canonicalise(p, a, self._acts_on) for p, a in zip(points, actions, strict=True)]
        numbers = np.array([ARRANGE if arranging else rope.primitive for rope in ropes], np.intp)
        for number in np.unique(numbers).tolist():
            rows = np.flatnonzero(numbers == number)
            if number not in self.primitives:
                raise ValueError(
                    f"{actions[rows[0]]} is an action of primitive {number}; this library has "
                    f"primitives {', '.join(map(str, self.primitives))}"
                )
            yield number, rows, encode_canonical([ropes[row] for row in rows], arranging)

    def save(self, path: Path, half: bool = False) -> None:
        """Write to a safetensors file; in half precision for half the size, to be shipped."""
        weights = {
            f"{number}.{name}": value.half() if half else value
            for number, primitive in self.primitives.items()
            for name, value in primitive.state_dict().items()
        }
        entries = {
            number: {
                "config": asdict(primitive.config),
                "actions": [*map(str, self.trained_on[number])],
            }
            for number, primitive in self.primitives.items()
        }
        about = {"format": FORMAT, "version": VERSION, "primitives": json.dumps(entries)}
        about |= {"rope": json.dumps(asdict(self.rope)), "digest": _digest(weights)}
        about["next_values"] = str(self.next_values)
        about["proportions"] = json.dumps(self.proportions and asdict(self.proportions))
        save_weights(path, weights, about, half=False)

    @classmethod
    def load(cls, path: Path, rope: RopeConfig | None = None) -> PrimitiveLibrary:
        """Read what `save` wrote.

        The path is of the file, or a folder of files with some of the primitives each.

        Raises:
            FileNotFoundError: there is no such file, or none in the folder.
            LibraryError: it is damaged, of another format, or was trained with another `rope`.
        """
        path = Path(path)
        if path.is_dir() and (parts := sorted(path.glob("*.safetensors"))):
            try:
                return cls.merged(cls.load(part, rope) for part in parts)
            except ValueError as error:
                raise LibraryError(f"{path}: {error}") from None
        if not path.is_file():
            raise FileNotFoundError(f"no library of primitives at {path}")
        metadata, weights = read_weights(path, LibraryError)
        if metadata.get("format") != FORMAT or metadata.get("version") != VERSION:
            raise LibraryError(
                f"{path} is {metadata.get('format', 'of an unknown format')!r} version "
                f"{metadata.get('version')}; this code reads {FORMAT!r} version {VERSION}"
            )
        if metadata.get("digest") != _digest(weights):
            raise LibraryError(f"{path} is damaged: its weights do not have the digest it names")
        try:
            entries = json.loads(metadata["primitives"])
            rope_fields = json.loads(metadata["rope"])
            rope_fields.pop("root", None)  # in libraries of version 0.2
            trained_rope = RopeConfig(**rope_fields)
            # Older files do not say; next values came with self-play, as arranging did.
            next_values = metadata.get("next_values", str(str(ARRANGE) in entries)) == "True"
            among = json.loads(metadata.get("proportions", "null"))
            proportions = among and ProportionsConfig(**among)
            primitives, actions = {}, {}
            for number, entry in entries.items():
                primitives[int(number)] = _primitive(number, entry["config"], weights)
                actions[int(number)] = [parse_action(text) for text in entry["actions"]]
        except (AttributeError, KeyError, TypeError, ValueError, RuntimeError) as error:
            raise LibraryError(f"{path} does not fit this code: {error!r}") from None
        if rope is not None and rope != trained_rope:
            differences = ", ".join(
                f"{name} {was}, not {getattr(rope, name)}"
                for name, was in asdict(trained_rope).items()
                if was != getattr(rope, name)
            )
            raise LibraryError(f"{path} was trained with another rope: {differences}")
        return cls(primitives, actions, trained_rope, next_values, proportions)


def _primitive(number: str, config: dict[str, Any], weights: Mapping[str, Tensor]) -> Primitive:
    network = NetworkConfig(**config.get("network", {}))
    cem = CemConfig(**config.get("cem", {}))
    primitive = Primitive(PrimitiveConfig(**config | {"network": network, "cem": cem}))
    prefix = f"{number}."
    own = {
        name.removeprefix(prefix): value.float()
        for name, value in weights.items()
        if name.startswith(prefix)
    }
    primitive.load_state_dict(own)
    return primitive


def _digest(weights: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256()
    for name in sorted(weights):
        digest.update(name.encode())
        digest.update(weights[name].numpy().tobytes())
    return digest.hexdigest()


@sampler("primitives", needs=("primitives",))
def build(config: NoSettings, inputs: Mapping[str, Path]) -> PrimitiveLibrary:
    """From the output of a training stage, or what `PrimitiveLibrary.load` reads."""
    source = Path(inputs["primitives"])
    trained = source / FILE
    return PrimitiveLibrary.load(trained if trained.is_file() else source)
