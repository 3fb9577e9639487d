"""The solution DAG a search follows: every topological path to a goal, or just one of them."""

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
        """Use `to` or `along`; every node of the graph must lead to a goal in it."""
        self.graph = graph
        self.goals = frozenset(goals)
        backward = graph.reverse(copy=False)
        self._distance: dict[TopologicalState, int] = dict(
            nx.multi_source_dijkstra_path_length(backward, set(self.goals), weight=None)
        )
        # Sorted, so that a search depends on its seed only, not on how the graph was built.
        self._edges: dict[TopologicalState, tuple[Edge, ...]] = {
            state: tuple(
                sorted(
                    ((action, onward) for _, onward, action in graph.out_edges(state, "action")),
                    key=lambda edge: str(edge[0]),
                )
            )
            for state in graph
        }

    @classmethod
    def to(cls, *goals: TopologicalState) -> SolutionDag:
        """Every path from the trivial state to any of the goals.

        Raises:
            TypeError: no goal, or one that is not a TopologicalState.
        """
        return cls(solution_graph(*sorted(goals)), goals)

    @classmethod
    def along(cls, actions: Sequence[Action], start: TopologicalState | None = None) -> SolutionDag:
        """One topological path only, as in Sec. VII-A4: its last state is the goal.

        Args:
            actions: at least one, the first legal in `start`.
            start: where the path begins; the trivial state if None.

        Raises:
            ValueError: no action.
            IllegalActionError: an action that its state does not allow; says which rule it breaks.
        """
        if not actions:
            raise ValueError("a topological path needs at least one action, got none")
        state = start if start is not None else TopologicalState.trivial()
        graph = nx.MultiDiGraph()
        for action in actions:
            onward = state.apply(action)
            graph.add_edge(state, onward, key=str(action), action=action)
            state = onward
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
            UnreachableGoalError: the state is not in this DAG.
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
        """Refuse a rope from whose state no edges lead to the goal.

        Raises:
            UnreachableGoalError: says why the rope cannot go on from its state.
        """
        if state in self._distance:
            return
        most = max(goal.num_crossings for goal in self.goals)
        rule = "R1, R2 and Cross only add crossings"
        if state.num_crossings >= most:
            why = (
                f"the rope has {state.num_crossings} crossings already and the goal has {most}; "
                f"{rule}"
            )
        else:
            why = f"{rule}, and no sequence of them completes these crossings to the goal"
        raise UnreachableGoalError(
            f"the rope lies in the state {state}, which is none of the {len(self)} states of the "
            f"solution DAG of {self._goal_names}: {why}. Lay the rope without these crossings, or "
            "choose a goal that contains them"
        )

    def after(self, start: TopologicalState) -> SolutionDag:
        """The part of this DAG that a rope in state `start` can still walk through.

        Raises:
            UnreachableGoalError: `start` is not in this DAG.
        """
        self.check_start(start)
        kept = {start} | nx.descendants(self.graph, start)
        return SolutionDag(self.graph.subgraph(kept).copy(), self.goals & kept)
