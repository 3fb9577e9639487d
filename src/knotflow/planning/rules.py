"""Nodes of a tree, and where it grows next: the paper's rule, and one by expected branches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import softmax

from knotflow.planning.config import PlannerConfig
from knotflow.planning.goals import Edge, SolutionDag
from knotflow.planning.plan import PlanStep
from knotflow.topology import Action, Arrange, TopologicalState
from knotflow.topology.polyline import Floats

PRIOR_WEIGHT = 3.0
"""Tries that the prior of a success probability counts as."""
MIN_PRIOR, MAX_PRIOR = 0.01, 0.98
"""Range of that prior: critics err, and no branch must be excluded."""
UNKNOWN = 0.5
"""Prior success probability in a state that was not reached yet, and of keeping a state."""
INITIAL_GAINS = (0.5, 1.0, 2.0)
"""Values after arranging, relative to the predicted ones, before any was observed."""
MAX_GAINS = 24
"""Latest gains that are kept of a state."""
ACT, ARRANGE = KINDS = 0, 1
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
        reached: whether the arm, if any, follows all steps up to it; None where not yet known.
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
    reached: bool | None = None
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


class PaperRule:
    """Independent draws of a node, nearer to the goal with a bias, then of an edge (Sec. V-B d)."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._nodes: list[Node] = []

    def choose(self, count: int) -> list[Expansion]:
        """The next expansions of the nodes added so far."""
        chances = node_probabilities([node.distance for node in self._nodes])
        nodes = self._rng.choice(len(self._nodes), size=count, p=chances)
        chosen = [self._nodes[row] for row in nodes]
        return [Expansion(node, int(self._rng.integers(len(node.edges)))) for node in chosen]

    def add(self, node: Node) -> None:
        """Add a new, valued node, after the expansions of its batch were learned from."""
        self._nodes.append(node)

    def drop(self, nodes: Sequence[Node]) -> None:
        """Remove nodes; all their descendants are among them."""
        self._nodes = [node for node in self._nodes if node not in nodes]

    def learn(self, expansion: Expansion, child: Node | None) -> None:
        """Nothing: the outcomes of expansions change no probability."""


def node_probabilities(distances: Sequence[int]) -> Floats:
    """Probability (N,) of each node to be expanded next, the root's distance first.

    It is proportional to exp(2 p), where p is 1 at the root and doubles with each edge nearer to
    the goal, as in the authors' code; the paper does not say how strong its bias is.
    """
    advance = distances[0] - np.array(distances, float)
    return np.asarray(softmax(2 * 2**advance))


class ReservationPrices:
    """Weitzman's reservation prices of boxes with the same contents (M,) and different costs.

    A branch that succeeds with probability p is a box that costs 1/p branches to open and contains
    a shape from which the goal is K branches away, all `contents` equally likely. Boxes are best
    opened in the order of z, for which E max(z - K, 0) = 1/p (Weitzman 1979, Econometrica 47).
    """

    def __init__(self, contents: Floats) -> None:
        ordered = np.sort(contents)
        self._sums = np.cumsum(ordered)
        # Costs from which on so many more of the contents are worth keeping.
        kept = np.arange(1, len(ordered))
        self._costs = (kept * ordered[1:] - self._sums[:-1]) / len(ordered)

    def at(self, cost: Floats) -> Floats:
        """Z (...) of boxes with these costs (...)."""
        more = np.searchsorted(self._costs, cost)
        return np.asarray((len(self._sums) * cost + self._sums[more]) / (more + 1))


def _prices(contents: Floats, cost: Floats) -> Floats:
    """Reservation prices (...) of boxes with contents (..., M) of their own and costs (...)."""
    ordered = np.sort(contents, axis=-1)
    count = ordered.shape[-1]
    # If the k cheapest contents were the ones to keep, it would be this; it is the least of them.
    kept = (count * cost[..., None] + np.cumsum(ordered, axis=-1)) / np.arange(1, count + 1)
    return np.asarray(kept.min(axis=-1))


def _posterior(prior: Floats | float, tries: Floats, successes: Floats) -> Floats:
    return np.asarray((PRIOR_WEIGHT * prior + successes) / (PRIOR_WEIGHT + tries))


@dataclass(eq=False)
class StateStatistics:
    """All N shapes of one state, and what is known of its E edges in the solution DAG.

    Attributes:
        gains: ratios of values after arranging to the predicted ones, where the state was kept.
        tries: (2, E) expansions of all of them; see `ACT` and `ARRANGE`.
        successes: (2, E) those that succeeded.
        predicted: (E,) successes that the values predicted of those that acted.
        prices: (2, N, E) reservation prices of acting and arranging, as last computed, else None.
    """

    edges: tuple[Edge, ...]
    nodes: list[Node] = field(default_factory=list)
    gains: list[float] = field(default_factory=lambda: list(INITIAL_GAINS))
    tries: Floats = field(init=False)
    successes: Floats = field(init=False)
    predicted: Floats = field(init=False)
    prices: Floats | None = None

    def __post_init__(self) -> None:
        self.tries, self.successes = np.zeros((2, 2, len(self.edges)))
        self.predicted = np.zeros(len(self.edges))

    def evaluate(self, ahead: list[ReservationPrices], max_arranging: int) -> Floats:
        """Compute the prices, with the shapes `ahead` at each edge's end."""
        ratio = (PRIOR_WEIGHT + self.successes[ACT]) / (PRIOR_WEIGHT + self.predicted)  # (E,)
        tries = np.array([node.tries for node in self.nodes])  # (N, 2, E)
        successes = np.array([node.successes for node in self.nodes])
        values = np.array([node.values for node in self.nodes])
        arranged_values = np.array([node.arranged_values for node in self.nodes])

        def act(values: Floats) -> Floats:
            """(N, E) prices of acting from shapes of these values."""
            prior = np.clip(np.maximum(values, MIN_PRIOR) * ratio, MIN_PRIOR, MAX_PRIOR)
            cost = 1.0 / _posterior(prior, tries[:, ACT], successes[:, ACT])
            return np.stack([box.at(cost[:, edge]) for edge, box in enumerate(ahead)], axis=1)

        kept = self.successes[ARRANGE].sum() + PRIOR_WEIGHT * UNKNOWN
        kept /= self.tries[ARRANGE].sum() + PRIOR_WEIGHT
        keeps = _posterior(kept, tries[:, ARRANGE], successes[:, ARRANGE])
        # What was tried from a shape counts for those arranged from it, which are much alike.
        arranged = np.stack([act(gain * arranged_values) for gain in self.gains], axis=-1)
        arrange = _prices(arranged, 1.0 / keeps)
        arrange[[node.num_arranging >= max_arranging for node in self.nodes]] = np.inf
        self.prices = np.stack([act(values), arrange])
        return self.prices


class PosteriorRule:
    """Grows the branches with the least reservation prices.

    The prior of a success probability is the shape's value, corrected by the ratio of successes to
    predictions in its state; its evidence is what was tried from that very shape. A box
    (`ReservationPrices`) contains the shapes in which the next state, or by arranging the same one,
    was met so far. A batch counts its own unfinished branches as failures.
    """

    def __init__(self, config: PlannerConfig, dag: SolutionDag) -> None:
        self._max_arranging, self._dag = config.arranging, dag
        self._statistics: dict[TopologicalState, StateStatistics] = {}

    def choose(self, count: int) -> list[Expansion]:
        ahead: dict[TopologicalState, list[ReservationPrices]] = {}
        prices: dict[TopologicalState, Floats] = {}
        # From the goal backward, as prices ahead enter those behind. In cycles, which undoing
        # makes, they are those of the choice before.
        for state in sorted(self._statistics, key=lambda one: (self._dag.distance(one), one)):
            known = self._statistics[state]
            if known.nodes:
                ahead[state] = [self._prices_in(end) for _, end in known.edges]
                prices[state] = known.evaluate(ahead[state], self._max_arranging)
        chosen = []
        for _ in range(count):
            state = min(prices, key=lambda one: prices[one].min())
            known = self._statistics[state]
            least = np.unravel_index(prices[state].argmin(), prices[state].shape)
            kind, row, edge = map(int, least)
            chosen.append(Expansion(known.nodes[row], edge, kind))
            known.nodes[row].tries[kind, edge] += 1
            if len(chosen) < count:
                prices[state] = known.evaluate(ahead[state], self._max_arranging)
        return chosen

    def add(self, node: Node) -> None:
        """Add a node to its state, with its parent's evidence if it was arranged."""
        if not node.edges:
            return
        self._statistics.setdefault(node.state, StateStatistics(node.edges)).nodes.append(node)
        if node.num_arranging and node.parent is not None:
            node.tries[ACT] = node.parent.tries[ACT]
            node.successes[ACT] = node.parent.successes[ACT]

    def drop(self, nodes: Sequence[Node]) -> None:
        """Remove the nodes; what was learned from them is kept."""
        for known in self._statistics.values():
            remaining = [node for node in known.nodes if node not in nodes]
            if len(remaining) < len(known.nodes):
                known.nodes, known.prices = remaining, None

    def learn(self, expansion: Expansion, child: Node | None) -> None:
        """Compare the outcome of an expansion with its prediction."""
        node, edge, kind = expansion.node, expansion.edge, expansion.kind
        known = self._statistics[node.state]
        success = child is not None and child.state == expansion.goal
        node.successes[kind, edge] += success
        known.tries[kind, edge] += 1
        known.successes[kind, edge] += success
        if kind == ACT:
            known.predicted[edge] += np.clip(node.values[edge], MIN_PRIOR, MAX_PRIOR)
        elif child is not None and success:
            gain = child.values[edge] / max(node.arranged_values[edge], MIN_PRIOR)
            known.gains = [*known.gains, float(gain)][-MAX_GAINS:]

    def _prices_in(self, state: TopologicalState) -> ReservationPrices:
        """Of the unarranged shapes in which a state was met, and one of which nothing is known."""
        unknown = np.array([self._dag.distance(state) / UNKNOWN])
        known = self._statistics.get(state)
        if known is None or known.prices is None:
            return ReservationPrices(unknown)
        nodes = known.nodes[: known.prices.shape[1]]  # the latest may not have been evaluated yet
        rows = [row for row, node in enumerate(nodes) if not node.num_arranging]
        least = known.prices[:, rows].min(axis=(0, 2))
        return ReservationPrices(np.concatenate([unknown, least]))
