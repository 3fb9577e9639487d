"""The graph that a search follows: every topological path to a goal, or just one of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import networkx as nx

from knotflow.topology import Action, TopologicalState, solution_graph

Edge = tuple[Action, TopologicalState]
"""An action and the state it leads to."""


class UnreachableGoalError(ValueError):
    """No sequence of actions leads from the rope's state to the goal."""


class SolutionDag:
    """Topological states and the actions between them that lead to a goal (Sec. V-B d).

    Attributes:
        graph: nodes are TopologicalStates; an edge has its Action in the attribute `action`.
        goals: the states in which the knot is tied.
    """

    def __init__(self, graph: nx.MultiDiGraph, goals: Iterable[TopologicalState]) -> None:
        """Every node of the graph leads to a goal in it."""
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

    @property
    def _goal_names(self) -> str:
        return ", ".join(sorted(map(str, self.goals)))

    def __contains__(self, state: TopologicalState) -> bool:
        return state in self._distance

    def __len__(self) -> int:
        return len(self._distance)

    def distance(self, state: TopologicalState) -> int:
        """Edges on the shortest path from a state to the nearest goal.

        Raises:
            UnreachableGoalError: the state is not in this graph.
        """
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
        if state in self:
            return
        most = max(goal.num_crossings for goal in self.goals)
        why = "no sequence of R1, R2 and Cross completes these crossings to the goal"
        if state.num_crossings >= most:
            why = (
                f"R1, R2 and Cross only add crossings, but the rope already has "
                f"{state.num_crossings} and the goal has {most}"
            )
        raise UnreachableGoalError(
            f"the rope is in the state {state}, which is none of the {len(self)} states that lead "
            f"to {self._goal_names}: {why}. Lay the rope without these crossings, or choose a goal "
            "that contains them"
        )

    def after(self, start: TopologicalState) -> SolutionDag:
        """The part of this graph that can be reached from a state.

        Raises:
            UnreachableGoalError: `start` is not in this graph.
        """
        self.check_start(start)
        kept = {start} | nx.descendants(self.graph, start)
        return SolutionDag(self.graph.subgraph(kept).copy(), self.goals & kept)


class SearchGraph(SolutionDag):
    """A solution DAG with, from each of its states and of given others, all that can be undone.

    Attributes:
        dag: the solution DAG it was made from.
    """

    def __init__(self, dag: SolutionDag, *starts: TopologicalState) -> None:
        """Join a solution DAG with all that its states and the starts can be undone to.

        Raises:
            UnreachableGoalError: no actions and undoings lead from a start to a goal.
        """
        graph = dag.graph.copy()
        for state in _undone(dag.graph):
            for undoing, previous in state.undo_actions():
                graph.add_edge(state, previous, key=str(undoing), action=undoing)
        leading = set(dag.goals).union(*(nx.ancestors(graph, goal) for goal in dag.goals))
        super().__init__(graph.subgraph(leading).copy(), dag.goals)
        self.dag = dag
        for start in starts:
            self.extend(start)

    def extend(self, state: TopologicalState) -> None:
        """Add a state, if it is new, and all that it can be undone to.

        Distances and edges of present states do not change.

        Raises:
            UnreachableGoalError: no undoings lead from the state into the graph.
        """
        if state in self:
            return
        # Undoing reduces crossings, so a state comes after all those that it can be undone to.
        new = [below for below in _undone([state]) if below not in self]
        for below in sorted(new, key=lambda one: (one.num_crossings, one)):
            edges = [edge for edge in below.undo_actions() if edge[1] in self]
            if not edges:
                continue
            for undoing, previous in edges:
                self.graph.add_edge(below, previous, key=str(undoing), action=undoing)
            self._edges[below] = _sorted(edges)
            self._distance[below] = 1 + min(self._distance[previous] for _, previous in edges)
        self.check_start(state)

    def check_start(self, state: TopologicalState) -> None:
        """Raise an `UnreachableGoalError` for a state that is not in this graph."""
        if state not in self:
            raise UnreachableGoalError(
                f"no undoings are known from the state {state} to any of the {len(self)} states "
                f"from which actions and undoings lead to {self._goal_names}"
            )


def _sorted(edges: Iterable[Edge]) -> tuple[Edge, ...]:
    return tuple(sorted(edges, key=lambda edge: str(edge[0])))


def _undone(states: Iterable[TopologicalState]) -> set[TopologicalState]:
    """The states and all that they can be undone to."""
    found = set(states)
    waiting = list(found)
    while waiting:
        for _, previous in waiting.pop().undo_actions():
            if previous not in found:
                found.add(previous)
                waiting.append(previous)
    return found
