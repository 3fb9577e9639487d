"""What to tie: a knot by name, by its crossings, or by one topological path to it."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass

from knotflow.planning.dag import SolutionDag
from knotflow.simulation import RopeConfig
from knotflow.topology import (
    KNOT_NAMES,
    Action,
    InvalidStateError,
    TopologicalState,
    knot,
    parse_action,
)

SEGMENT_RADII = 4.0
"""Least length of a segment in rope radii: see `most_crossings`."""

_ACTION = re.compile(r"(?:undo\s+)?[A-Z]\w*\s*\([^()]*\)")
_SEPARATORS = re.compile(r"[\s,;]*")


class NoRoomError(ValueError):
    """A goal with more crossings than the rope has room for."""


@dataclass(frozen=True)
class Goal:
    """What to tie.

    Attributes:
        name: how it was asked for: a knot's name, a state's `str`, or a path's actions.
        dag: the states and actions to search through.
    """

    name: str
    dag: SolutionDag

    @property
    def states(self) -> frozenset[TopologicalState]:
        """The states in which the knot is tied."""
        return self.dag.goals

    @classmethod
    def named(cls, name: str) -> Goal:
        """Every state of a knot of this name."""
        return cls(name, SolutionDag.to(*knot(name)))

    @classmethod
    def state(cls, state: TopologicalState) -> Goal:
        """Exactly one state."""
        return cls(str(state), SolutionDag.to(state))

    @classmethod
    def path(cls, actions: Sequence[Action], start: TopologicalState | None = None) -> Goal:
        """The state at the end of one topological path, by this path only (Sec. VII-A4)."""
        return cls(" ".join(map(str, actions)), SolutionDag.along(actions, start))


def parse_goal(text: str, rope: RopeConfig | None = None) -> Goal:
    """The goal that a text names.

    Args:
        text: one of
            a knot's name: "overhand", "figure_eight", "pentagram", ...;
            crossings "4o1+2o5+6o3+" or (over, under, sign) triples "[(4,1,1),(2,5,1),(6,3,1)]";
            a topological path from the untangled rope: "R1(0,1,1) C(0,1,1) undo C(0,1,1)".
        rope: refuse a goal that this rope has no room for; not checked if None.

    Raises:
        NoRoomError: more crossings than the rope has room for.
        InvalidStateError: crossings that contradict each other.
        IllegalActionError: a path with an action that its state does not allow.
        ValueError: anything else; lists the valid forms.
    """
    text = text.strip()
    if text in KNOT_NAMES:
        _check_room(text, knot(text), rope)
        return Goal.named(text)
    actions = _ACTION.findall(text)
    if actions and _SEPARATORS.fullmatch(_ACTION.sub("", text)):
        goal = Goal.path([parse_action(action) for action in actions])
        _check_room(text, goal.states, rope)
        return goal
    state = _parse_state(text)
    _check_room(text, [state], rope)  # first, for the DAG of very many crossings is large
    return Goal.state(state)


def most_crossings(rope: RopeConfig) -> int:
    """How many crossings fit on a rope, tightly packed.

    Each of the 2c + 1 segments takes at least `SEGMENT_RADII` radii and one link of the model.
    """
    segment = max(SEGMENT_RADII * rope.radius, rope.link_length)
    # Half a micrometre of slack, for 1 m over 40 links is 25 mm only up to rounding.
    return max(0, int((rope.length + 5e-7) / segment - 1) // 2)


def _check_room(
    text: str,
    goals: Sequence[TopologicalState] | frozenset[TopologicalState],
    rope: RopeConfig | None,
) -> None:
    if rope is None:
        return
    crossings = min(goal.num_crossings for goal in goals)
    room = most_crossings(rope)
    if crossings > room:
        raise NoRoomError(
            f"the goal {text} has {crossings} crossings, but a rope of {rope.length:g} m with a "
            f"radius of {rope.radius * 1e3:g} mm in {rope.links} links has room for about {room}: "
            f"each of the 2c + 1 segments takes at least {SEGMENT_RADII:g} radii and one link; "
            "take a longer or thinner rope"
        )


def _parse_state(text: str) -> TopologicalState:
    forms = (
        f"write a knot's name ({', '.join(KNOT_NAMES)}), crossings ('4o1+2o5+6o3+' or "
        "'[(4,1,1),(2,5,1),(6,3,1)]' as (over, under, sign)), or a topological path "
        "('R1(0,1,1) C(0,1,1) C(2,0,1)')"
    )
    if text.startswith(("[", "(")):
        try:
            triples = ast.literal_eval(text)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
            raise ValueError(f"the crossings {text!r} cannot be read; {forms}") from None
        listed = isinstance(triples, list | tuple)
        if not listed or not all(isinstance(triple, list | tuple) for triple in triples):
            raise InvalidStateError(f"{text!r} is not a list of crossings; {forms}")
        return TopologicalState.from_crossings(triples)
    if not re.match(r"\d|trivial$", text):
        raise ValueError(f"unknown knot {text!r}; {forms}")
    return TopologicalState.parse(text)
