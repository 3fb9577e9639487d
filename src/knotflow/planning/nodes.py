"""What a search tree is made of: nodes, expansions, and reports of its growth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from knotflow.planning.goals import Edge
from knotflow.planning.plan import PlanStep
from knotflow.simulation import Attempts, Rollouts
from knotflow.topology import Action, Arrange, TopologicalState
from knotflow.topology.polyline import Floats

ACT, ARRANGE = 0, 1
"""The two kinds of expansions: for the action of an edge, or to make room for it."""


@dataclass(eq=False)
class Node:
    """A rope (V, 3), metres, at rest in the tree.

    Attributes:
        state: its topological state, one of the solution DAG.
        distance: edges from its state to the goal.
        edges: the E outgoing edges of its state in the solution DAG; none at the goal.
        parent: the node it was reached from by `step`; None for the root.
        steady: its step was simulated again and is reliable (`validation.are_robust`).
        failures: expansions of this node that did not become nodes.
        values: (E,) probability of success along each edge; 1 where unknown.
        arranged_values: (E,) the same after an arranging spline; `values` where unknown.
        tries: (2, E) expansions of each kind, `ACT` and `ARRANGE`.
        successes: (2, E) those that reached the edge's state, or kept this one.
    """

    points: Floats
    state: TopologicalState
    distance: int
    edges: tuple[Edge, ...] = ()
    parent: Node | None = None
    step: PlanStep | None = None
    steady: bool = False
    failures: int = 0
    values: Floats = field(init=False)
    arranged_values: Floats = field(init=False)
    tries: Floats = field(init=False)
    successes: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.values = self.arranged_values = np.ones(len(self.edges))
        self.tries, self.successes = np.zeros((2, 2, len(self.edges)))

    @property
    def num_arranging(self) -> int:
        """How many arranging steps in a row led here."""
        if self.parent is None or self.step is None or not isinstance(self.step.action, Arrange):
            return 0
        return 1 + self.parent.num_arranging

    def path(self) -> tuple[Node, ...]:
        """The nodes from the root, which is left out, to this one."""
        return () if self.parent is None else (*self.parent.path(), self)


def steps_to(nodes: Sequence[Node]) -> tuple[PlanStep, ...]:
    """The step by which each node was reached; the root has none."""
    return tuple(node.step for node in nodes if node.step is not None)


@dataclass(frozen=True, eq=False)
class Expansion:
    """A spline to be executed from a node for one of its edges; `kind` is ACT or ARRANGE."""

    node: Node
    edge: int
    kind: int = ACT

    @property
    def edge_action(self) -> Action:
        """The action of the edge."""
        return self.node.edges[self.edge][0]

    @property
    def action(self) -> Action:
        """What the spline does: the edge's action, or arranging for it."""
        return Arrange(self.edge_action) if self.kind == ARRANGE else self.edge_action

    @property
    def goal(self) -> TopologicalState:
        """The state in which it succeeds."""
        return self.node.state if self.kind == ARRANGE else self.node.edges[self.edge][1]


@dataclass(frozen=True)
class SearchUpdate:
    """What a search reports after each batch."""

    branches: int
    """Splines simulated so far."""
    nodes: int
    """Nodes of the tree, including the root."""
    distance: int
    """Edges from the nearest node to the goal; 0 when solved."""
    seconds: float
    """Wall time so far."""


Progress = Callable[[SearchUpdate], None]


def group_by_action(
    chosen: Sequence[Expansion],
    splines: Floats,
    rollouts: Rollouts,
    ends: Sequence[TopologicalState | None],
) -> Iterator[Attempts]:
    """A batch of expansions, grouped by start state and action."""
    rows: dict[tuple[TopologicalState, Action], list[int]] = {}
    for row, expansion in enumerate(chosen):
        rows.setdefault((expansion.node.state, expansion.action), []).append(row)
    for (state, action), same in rows.items():
        points = np.stack([chosen[row].node.points for row in same])
        outcome = tuple(ends[row] for row in same)
        yield Attempts.of(action, state, points, splines[same], rollouts[same], outcome)
