"""Where a tree grows next: where the fewest further branches are expected to reach the goal.

The chance that a spline takes a shape along an edge has a posterior mean. Its prior is the value
of the shape, weighed as a few tries, and its evidence what was tried from that very shape. What
values promise is held against what came of it: for each state and action the ratio of successes to
promises corrects every value.

A branch that succeeds with chance p is a box with a price of 1/p branches, and in it a shape of the
next state, from which the goal is so and so many branches away: as many as from one of the shapes
that this state was met in so far. A box need not be the last: a shape that turns out tight can be
left for another. By Weitzman (1979, Optimal search for the best alternative, Econometrica 47) the
boxes are to be opened in the order of their reservation prices, which is the price z of a shape at
which opening saves on the average just what it costs, E max(z - K, 0) = 1/p for contents K. The
same holds for arranging, whose boxes hold shapes of the same state. So going on from a shape,
arranging it, taking another one, and going back to grow a roomier one from its parent compare by
one number each, and branches go where it is least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import ACT, ARRANGE, Branch, Node
from knotflow.planning.config import PlannerConfig
from knotflow.planning.dag import Edge, SolutionDag
from knotflow.topology import TopologicalState

TRUST = 3.0
"""Tries that a prior weighs."""
LEAST_VALUE, MOST_VALUE = 0.01, 0.98
"""No prior is surer than this: critics err, and a branch must not be given up for good."""
UNKNOWN = 0.5
"""Prior mean of acting along an edge from a state that was not met yet, and of keeping a state."""
GAINS = (0.5, 1.0, 2.0)
"""Values after arranging, relative to what was promised, until it was seen."""
REMEMBERED = 24
"""Gains of a state that are kept, the last ones."""


class Boxes:
    """Reservation prices of boxes whose contents are alike and whose prices differ.

    Args:
        contents: (M,) equally likely costs K of what is in a box, less is better.
    """

    def __init__(self, contents: NDArray) -> None:
        ordered = np.sort(contents)
        self._sums = np.cumsum(ordered)
        # Prices from which on so many more of the contents are worth keeping.
        kept = np.arange(1, len(ordered))
        self._prices = (kept * ordered[1:] - self._sums[:-1]) / len(ordered)

    def index(self, price: NDArray) -> NDArray[np.float64]:
        """z (...) at which E max(z - K, 0) is the price (...)."""
        more = np.searchsorted(self._prices, price)
        return np.asarray((len(self._sums) * price + self._sums[more]) / (more + 1))


@dataclass(eq=False)
class Pool:
    """All shapes of one state, and what is known of its E edges.

    Attributes:
        edges: of the state in the solution DAG.
        nodes: N shapes.
        gains: what arranging made of the value it promised, where it kept the state.
        tries: (2, E) branches from all of them; see `branches.ACT` and `ARRANGE`.
        successes: (2, E) those that succeeded.
        promised: (E,) successes that the values promised of those that acted.
        costs: (2, N, E) reservation prices of acting and arranging, as last computed.
    """

    edges: tuple[Edge, ...]
    nodes: list[Node] = field(default_factory=list)
    gains: list[float] = field(default_factory=lambda: list(GAINS))
    tries: NDArray[np.float64] = field(init=False)
    successes: NDArray[np.float64] = field(init=False)
    promised: NDArray[np.float64] = field(init=False)
    costs: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        """Nothing was tried yet."""
        self.tries, self.successes = np.zeros((2, 2, len(self.edges)))
        self.promised = np.zeros(len(self.edges))

    def fresh(self) -> NDArray[np.float64]:
        """Costs of the shapes that this state was met in, those that were arranged left out."""
        nodes = self.nodes[: self.costs.shape[1]]  # the latest may not have been appraised yet
        met = [row for row, node in enumerate(nodes) if not node.arranged]
        return self.costs[:, met].min(axis=(0, 2))

    def appraise(self, onward: list[Boxes], arranging: int) -> None:
        """Compute the costs.

        Args:
            onward: for each edge the shapes to be had at its end.
            arranging: most arranging steps in a row.
        """
        ratio = (TRUST + self.successes[ACT]) / (TRUST + self.promised)  # (E,)
        tries = np.array([node.tries for node in self.nodes])  # (N, 2, E)
        successes = np.array([node.successes for node in self.nodes])
        values = np.array([node.survival * node.values for node in self.nodes])
        act = self._acting(onward, ratio, values, tries[:, ACT], successes[:, ACT])

        kept = self.successes[ARRANGE].sum() + TRUST * UNKNOWN
        kept /= self.tries[ARRANGE].sum() + TRUST
        keeps = _posterior(kept, tries[:, ARRANGE], successes[:, ARRANGE])
        promise = np.array([node.survival * node.arranged_values for node in self.nodes])
        # What was tried from a shape speaks for those arranged from it, which are much alike.
        evidence = tries[:, ACT], successes[:, ACT]
        arranged = [self._acting(onward, ratio, gain * promise, *evidence) for gain in self.gains]
        arrange = _indices(np.stack(arranged, axis=-1), 1.0 / keeps)
        arrange[[node.arranged >= arranging for node in self.nodes]] = np.inf
        self.costs = np.stack([act, arrange])

    def _acting(
        self,
        onward: list[Boxes],
        ratio: NDArray,
        values: NDArray,
        tries: NDArray,
        successes: NDArray,
    ) -> NDArray[np.float64]:
        """(N, E) reservation prices of acting from shapes of these values and this evidence."""
        prior = np.clip(np.maximum(values, LEAST_VALUE) * ratio, LEAST_VALUE, MOST_VALUE)
        price = 1.0 / _posterior(prior, tries, successes)
        return np.stack([boxes.index(price[:, edge]) for edge, boxes in enumerate(onward)], axis=1)


class PosteriorRule:
    """Grows the cheapest branches; a batch counts its own unfinished ones as failures so far."""

    def __init__(self, config: PlannerConfig, dag: SolutionDag) -> None:
        self._arranging, self._dag = config.arranging, dag
        self._pools: dict[TopologicalState, Pool] = {}

    def choose(self, count: int) -> list[Branch]:
        """The branches with the least reservation prices."""
        onward: dict[TopologicalState, list[Boxes]] = {}
        # From the goal backward, as costs ahead enter those behind; round a circle, as there are
        # where actions can be undone, they are those of the choice before.
        for state in sorted(self._pools, key=lambda state: (self._dag.distance(state), state)):
            pool = self._pools[state]
            if not pool.nodes:
                continue
            onward[state] = [self._boxes(ahead) for _, ahead in pool.edges]
            pool.appraise(onward[state], self._arranging)
        chosen = []
        for _ in range(count):
            state = min(onward, key=lambda state: self._pools[state].costs.min())
            pool = self._pools[state]
            place = np.unravel_index(pool.costs.argmin(), pool.costs.shape)
            kind, row, edge = map(int, place)
            chosen.append(Branch(pool.nodes[row], edge, kind))
            pool.nodes[row].tries[kind, edge] += 1
            if len(chosen) < count:
                pool.appraise(onward[state], self._arranging)
        return chosen

    def add(self, node: Node) -> None:
        """Put a node into the pool of its state, with its parent's evidence if it was arranged."""
        if not node.edges:
            return
        self._pools.setdefault(node.state, Pool(node.edges)).nodes.append(node)
        if node.arranged and node.parent is not None:
            node.tries[ACT] = node.parent.tries[ACT]
            node.successes[ACT] = node.parent.successes[ACT]

    def drop(self, nodes: Sequence[Node]) -> None:
        """Take them out of their pools, which keep what was learned from them."""
        for pool in self._pools.values():
            left = [node for node in pool.nodes if node not in nodes]
            if len(left) < len(pool.nodes):
                pool.nodes = left
                vars(pool).pop("costs", None)  # not computed yet for a new pool

    def learn(self, branch: Branch, child: Node | None) -> None:
        """Hold the outcome of a branch against what was promised."""
        node, edge, kind = branch.node, branch.edge, branch.kind
        pool = self._pools[node.state]
        success = child is not None and child.state == branch.goal
        node.successes[kind, edge] += success
        pool.tries[kind, edge] += 1
        pool.successes[kind, edge] += success
        if kind == ACT:
            promised = node.survival * node.values[edge]
            pool.promised[edge] += np.clip(promised, LEAST_VALUE, MOST_VALUE)
        elif child is not None and success:
            gain = child.values[edge] / max(node.arranged_values[edge], LEAST_VALUE)
            pool.gains = [*pool.gains, float(gain)][-REMEMBERED:]

    def _boxes(self, state: TopologicalState) -> Boxes:
        """What is to be had of a state: the shapes it was met in, and one nothing is known of.

        Without the latter a few tight shapes would condemn a state.
        """
        unknown = np.array([self._dag.distance(state) / UNKNOWN])
        pool = self._pools.get(state)
        if pool is None or not hasattr(pool, "costs"):
            return Boxes(unknown)
        return Boxes(np.concatenate([unknown, pool.fresh()]))


def _indices(contents: NDArray, price: NDArray) -> NDArray[np.float64]:
    """Reservation prices (...) of boxes with contents (..., M) of their own; see `Boxes`."""
    ordered = np.sort(contents, axis=-1)
    count = ordered.shape[-1]
    # Were the k cheapest contents the ones to keep, it would be this; it is the least of them.
    kept = (count * price[..., None] + np.cumsum(ordered, axis=-1)) / np.arange(1, count + 1)
    return np.asarray(kept.min(axis=-1))


def _posterior(prior: NDArray | float, tries: NDArray, successes: NDArray) -> NDArray[np.float64]:
    return np.asarray((TRUST * prior + successes) / (TRUST + tries))
