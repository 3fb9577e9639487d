"""What to tie, and the graph that a search for it follows (Sec. V-B d)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import networkx as nx

from knotflow.simulation import RopeConfig
from knotflow.topology import (
    KNOT_NAMES,
    Action,
    TopologicalState,
    Undo,
    is_knot_name,
    knot,
    parse_action,
    solution_graph,
)

Edge = tuple[Action, TopologicalState]
"""An action and the state it leads to."""

SEGMENT_RADII = 4.0  # least length of a segment, tightly packed

_ACTION = re.compile(r"(?:undo\s+)?[A-Z]\w*\s*\([^()]*\)")


class UnreachableGoalError(ValueError):
    """No sequence of actions leads from the rope's state to the goal."""


class SolutionDag:
    """Topological states and the actions between them that all lead to a goal (Sec. V-B d).

    Attributes:
        graph: nodes are TopologicalStates; an edge has its Action in the attribute `action`.
        goals: the states in which the knot is tied.
    """

    def __init__(self, graph: nx.MultiDiGraph, goals: Iterable[TopologicalState]) -> None:
        self.graph = graph
        self.goals = frozenset(goals)
        backward = graph.reverse(copy=False)
        self._distance: dict[TopologicalState, int] = dict(
            nx.multi_source_dijkstra_path_length(backward, set(self.goals), weight=None)
        )
        # Sorted, so that a search depends on its seed only, not on how the graph was built.
        self._edges: dict[TopologicalState, tuple[Edge, ...]] = {
            state: _sorted((action, end) for _, end, action in graph.out_edges(state, "action"))
            for state in graph
        }

    @classmethod
    def to(cls, *goals: TopologicalState) -> SolutionDag:
        """Every path from the trivial state to any of the goals."""
        return cls(solution_graph(*sorted(goals)), goals)

    @classmethod
    def along(cls, actions: Sequence[Action], start: TopologicalState | None = None) -> SolutionDag:
        """One topological path (Sec. VII-A4) from `start`, or the trivial state, to its last state.

        Raises:
            ValueError: no action.
            IllegalActionError: an action that its state does not allow.
        """
        if not actions:
            raise ValueError("a topological path needs at least one action, got none")
        state = start if start is not None else TopologicalState.trivial()
        graph = nx.MultiDiGraph()
        for action in actions:
            end = state.apply(action)
            graph.add_edge(state, end, key=str(action), action=action)
            state = end
        return cls(graph, [state])

    def __contains__(self, state: TopologicalState) -> bool:
        return state in self._distance

    def __len__(self) -> int:
        return len(self._distance)

    def distance(self, state: TopologicalState) -> int:
        """Edges on the shortest path from a state to the nearest goal; raises as `check_start`."""
        self.check_start(state)
        return self._distance[state]

    def edges_from(self, state: TopologicalState) -> tuple[Edge, ...]:
        """The outgoing edges of a state, in a fixed order; none for a final goal."""
        return self._edges[state]

    def shortest_path(self, state: TopologicalState) -> list[Action]:
        """Actions of a shortest path from a state to a goal; the first of equals."""
        actions = []
        while state not in self.goals:
            action, state = min(self._edges[state], key=lambda edge: self._distance[edge[1]])
            actions.append(action)
        return actions

    def check_start(self, state: TopologicalState) -> None:
        """Raise an `UnreachableGoalError` for a state that is not in this graph."""
        if state not in self:
            raise UnreachableGoalError(
                f"no known actions lead from the rope's state {state} to "
                f"{', '.join(sorted(map(str, self.goals)))}: lay the rope without these crossings, "
                "or choose a goal that contains them"
            )

    def after(self, start: TopologicalState) -> SolutionDag:
        """The part of this graph that can be reached from a state; raises as `check_start`."""
        self.check_start(start)
        kept = {start} | nx.descendants(self.graph, start)
        return SolutionDag(self.graph.subgraph(kept).copy(), self.goals & kept)

    def with_undoings(self, *starts: TopologicalState) -> SolutionDag:
        """This graph joined with all that its states, and the starts, can be undone to.

        Raises:
            UnreachableGoalError: no actions and undoings lead from a start to a goal.
        """
        graph = self.graph.copy()
        for before, state, action in solution_graph(*graph, *starts).edges(data="action"):
            undoing = Undo(action)
            graph.add_edge(state, before, key=str(undoing), action=undoing)
        leading = self.goals.union(*(nx.ancestors(graph, goal) for goal in self.goals))
        joined = SolutionDag(graph.subgraph(leading).copy(), self.goals)
        for start in starts:
            joined.check_start(start)
        return joined


@dataclass(frozen=True)
class Goal:
    """What to tie, as asked for by name, state or path, and what to search through."""

    name: str
    dag: SolutionDag

    @property
    def states(self) -> frozenset[TopologicalState]:
        """The states in which the knot is tied."""
        return self.dag.goals

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
            crossings "4o1+2o5+6o3+";
            a topological path from the untangled rope: "R1(0,1,1) C(0,1,1) C(2,0,1)". Its last
            state is the goal; what lies between two visits of one state may be left out.
        rope: refuse a goal that this rope has no room for; not checked if None.

    Raises:
        InvalidStateError: crossings that contradict each other.
        IllegalActionError: a path with an action that its state does not allow.
        ValueError: more crossings than the rope has room for, or anything else; lists the valid
            forms.
    """
    text = text.strip()
    actions = _ACTION.findall(text)
    if actions and not _ACTION.sub("", text).strip(" \t\n\r,;"):
        goal = Goal.path([parse_action(action) for action in actions])
        _check_room(text, goal.states, rope)
        return goal
    if is_knot_name(text):
        states = knot(text)
    elif re.match(r"\d|trivial$", text):
        state = TopologicalState.parse(text)
        text, states = str(state), frozenset([state])
    else:
        raise ValueError(
            f"unknown knot {text!r}; write a knot's name ({', '.join(KNOT_NAMES)}), crossings "
            "('4o1+2o5+6o3+'), or a topological path ('R1(0,1,1) C(0,1,1) C(2,0,1)')"
        )
    _check_room(text, states, rope)  # first, for the DAG of very many crossings is large
    return Goal(text, SolutionDag.to(*states))


def _check_room(text: str, goals: Iterable[TopologicalState], rope: RopeConfig | None) -> None:
    """Refuse crossings of which each of the 2c + 1 segments does not get its least length."""
    if rope is None:
        return
    crossings = min(goal.num_crossings for goal in goals)
    segment = max(SEGMENT_RADII * rope.radius, rope.link_length)
    # Half a micrometre of slack, for 1 m over 40 links is 25 mm only up to rounding.
    room = max(0, int((rope.length + 5e-7) / segment - 1) // 2)
    if crossings > room:
        raise ValueError(
            f"the goal {text} has {crossings} crossings, but a rope of {rope.length:g} m with a "
            f"radius of {rope.radius * 1e3:g} mm in {rope.links} links has room for about {room}: "
            f"each of the 2c + 1 segments takes at least {SEGMENT_RADII:g} radii and one link; "
            "take a longer or thinner rope"
        )


def _sorted(edges: Iterable[Edge]) -> tuple[Edge, ...]:
    return tuple(sorted(edges, key=lambda edge: str(edge[0])))
