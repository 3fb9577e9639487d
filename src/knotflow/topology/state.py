"""The topological state of a rope: the signed Gauss code of its projection (paper Sec. IV)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from operator import index

from numpy.typing import ArrayLike

from knotflow.topology.action import Action, Arrange, ForwardAction, IllegalActionError, Undo
from knotflow.topology.curve import project
from knotflow.topology.moves import ACTION_KINDS
from knotflow.topology.planar_map import Crossing, PlanarMap, trace_faces

_TOKEN = re.compile(r"(\d+)o(\d+)([+-])")
_TRIVIAL_TEXT = "trivial"


class InvalidStateError(ValueError):
    """Crossings that no projected open curve has."""


@dataclass(frozen=True, order=True)
class TopologicalState:
    """A rope's crossings, as (over, under, sign) with positions 1..2c from head to tail.

    The sign is that of (over direction x under direction) . z (Eq. 1). The triples are sorted by
    the first position at which each crossing is met.

    Raises:
        InvalidStateError: the triples contradict each other or cannot be drawn in the plane.
    """

    crossings: tuple[Crossing, ...]

    def __post_init__(self) -> None:
        """Check the crossings; `_trusted` skips this for results of legal actions."""
        object.__setattr__(self, "crossings", _in_order(_checked(self.crossings)))
        num_faces = len(self.planar_map.faces)
        if num_faces != self.num_crossings + 1:
            raise InvalidStateError(
                f"no plane curve has the crossings {list(self.crossings)}: "
                f"{self.num_crossings} crossings need {self.num_crossings + 1} faces "
                f"(Euler), these signs and positions give {num_faces}"
            )

    @classmethod
    def trivial(cls) -> TopologicalState:
        return cls._trusted(())

    @classmethod
    def from_crossings(cls, crossings: Iterable[Iterable[int]]) -> TopologicalState:
        """A state from (over, under, sign) triples in any order.

        Raises:
            InvalidStateError: says which is wrong, or that no plane curve has these crossings.
        """
        return cls(crossings)  # type: ignore[arg-type]  # checked and converted there

    @classmethod
    def from_curve(cls, points: ArrayLike) -> TopologicalState:
        """The state of a rope shape: points (V, 3) in metres, head first, z up (Sec. IV).

        Raises:
            DegenerateCurveError: the projection onto the table does not determine the state.
            ValueError: not finite (V, 3) numbers.
        """
        return cls.from_crossings(project(points).crossings)

    @classmethod
    def parse(cls, text: str) -> TopologicalState:
        """Read a state from its `str`, e.g. "trivial" or "4o1+2o5+6o3+".

        Raises:
            InvalidStateError: the text has another form, or its crossings no plane curve has.
        """
        if not isinstance(text, str):
            raise InvalidStateError(f"{text!r} is not a state's text")
        text = text.strip()
        if text == _TRIVIAL_TEXT:
            return cls.trivial()
        if not text or _TOKEN.sub("", text):
            raise InvalidStateError(
                f"{text!r} is not a state; write {_TRIVIAL_TEXT!r}, or OVERoUNDERSIGN for every "
                "crossing, as in '4o1+2o5+6o3+'"
            )
        return cls(tuple((int(o), int(u), int(s + "1")) for o, u, s in _TOKEN.findall(text)))

    @classmethod
    def _trusted(cls, crossings: Iterable[Crossing]) -> TopologicalState:
        """A state from crossings known to be valid, without the costly check."""
        state = object.__new__(cls)
        object.__setattr__(state, "crossings", _in_order(crossings))
        return state

    def __str__(self) -> str:
        tokens = (f"{o}o{u}{'+' if sign > 0 else '-'}" for o, u, sign in self.crossings)
        return "".join(tokens) or _TRIVIAL_TEXT

    @property
    def num_crossings(self) -> int:
        return len(self.crossings)

    @property
    def num_segments(self) -> int:
        """The number of segments, 2c + 1, numbered 0 (head) to 2c (tail)."""
        return 2 * len(self.crossings) + 1

    @cached_property
    def planar_map(self) -> PlanarMap:
        return trace_faces(self.crossings)

    def apply(self, action: Action) -> TopologicalState:
        """The one state that a legal action leads to.

        Raises:
            IllegalActionError: the state does not allow the action; says which rule it breaks.
        """
        if isinstance(action, Arrange):
            self.apply(action.wanted)  # raises where it is illegal
            return self
        if isinstance(action, Undo):
            return self.undo(action.action)
        if not isinstance(action, ForwardAction):
            raise TypeError(f"{action!r} is not an action; parse_action() reads texts")
        return self._after(action)

    def _after(self, action: ForwardAction) -> TopologicalState:
        added = action.new_crossings(self.planar_map)
        split = action.split_segments
        shift = [0] * (self.num_segments + 1)
        for segment in split:
            for position in range(segment + 1, self.num_segments):
                shift[position] += 1

        def position_of(segment: int, rank: int) -> int:
            # `segment` old points precede it, and the new ones of lower segment and rank.
            return segment + split.index(segment) + rank + 1

        old = ((o + shift[o], u + shift[u], sign) for o, u, sign in self.crossings)
        new = ((position_of(*o), position_of(*u), sign) for o, u, sign in added)
        return TopologicalState._trusted((*old, *new))

    def undo(self, action: ForwardAction) -> TopologicalState:
        """The state from which an action led to this one.

        Raises:
            IllegalActionError: the action does not lead to this state from anywhere.
        """
        previous = self._before(action)
        if previous is None:
            last = ", ".join(str(candidate) for candidate, _ in self.predecessors()) or "none"
            raise IllegalActionError(
                f"{action} does not lead to the state {self} from any state; actions that do: "
                f"{last}"
            )
        return previous

    def _before(self, action: ForwardAction) -> TopologicalState | None:
        removed = set(action.new_positions)
        remaining = (place for place in range(1, self.num_segments) if place not in removed)
        rank_of = {place: rank for rank, place in enumerate(remaining, 1)}
        kept = [(o, u, s) for o, u, s in self.crossings if o in rank_of and u in rank_of]
        if 2 * len(kept) + len(removed) != 2 * self.num_crossings:
            return None
        # Actions add points within a face, so they never make a drawable state out of an
        # undrawable one: when the action leads from here to `self`, this state is valid.
        previous = TopologicalState._trusted((rank_of[o], rank_of[u], s) for o, u, s in kept)
        try:
            return previous if previous._after(action) == self else None
        except IllegalActionError:
            return None

    def actions(self) -> Iterator[tuple[ForwardAction, TopologicalState]]:
        """Every legal action that adds crossings with the state it leads to, each action once."""
        for kind in ACTION_KINDS:
            for action in kind.legal(self.planar_map):
                yield action, self._after(action)

    def undo_actions(self) -> Iterator[tuple[Undo, TopologicalState]]:
        """Every legal Undo with the state it leads to, each once."""
        return ((Undo(action), previous) for action, previous in self.predecessors())

    def predecessors(self) -> Iterator[tuple[ForwardAction, TopologicalState]]:
        """Every action that leads here by adding crossings, with the state it leads from."""
        for kind in ACTION_KINDS:
            for action in kind.last_candidates(self.crossings):
                previous = self._before(action)
                if previous is not None:
                    yield action, previous

    def mirrored(self) -> TopologicalState:
        """The rope reflected about a line on the table: all signs change (Sec. V-A)."""
        return TopologicalState._trusted((o, u, -sign) for o, u, sign in self.crossings)

    def reversed(self) -> TopologicalState:
        """The rope with head and tail exchanged: positions count from the other end (Sec. V-A)."""
        count = self.num_segments
        return TopologicalState._trusted((count - o, count - u, s) for o, u, s in self.crossings)


def _in_order(crossings: Iterable[Crossing]) -> tuple[Crossing, ...]:
    return tuple(sorted(crossings, key=lambda crossing: min(crossing[0], crossing[1])))


def _checked(crossings: Iterable[Iterable[int]]) -> list[Crossing]:
    """The crossings as triples of ints that use each position 1..2c once, or InvalidStateError."""
    try:
        triples = [(index(over), index(under), index(sign)) for over, under, sign in crossings]
    except (TypeError, ValueError):
        raise InvalidStateError(
            f"crossings are triples of whole numbers (over, under, sign), got {crossings!r}"
        ) from None
    for triple in triples:
        if triple[2] not in (1, -1):
            raise InvalidStateError(f"crossing {triple}: the sign must be +1 or -1")
    positions = sorted(position for triple in triples for position in triple[:2])
    if positions != list(range(1, len(positions) + 1)):
        raise InvalidStateError(
            f"{len(triples)} crossings have each position from 1 to {len(positions)} once, "
            f"got {triples}"
        )
    return triples
