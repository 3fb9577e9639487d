"""Where a tree grows next: where the fewest further branches are expected to reach the goal.

The chance that a spline takes a shape along an edge has a posterior mean. Its prior is the critic's
value of the shape, weighed as a few tries, and its evidence what was tried from that very shape.
What critics promise is held against what came of it: for each state and action the ratio of
successes to promises corrects every value. A sampler without a critic promises 1 everywhere, and
the ratio is the rate of success so far.

A try with chance p succeeds after 1/p branches. So each edge of the solution DAG has a length, the
branches that a fresh shape of its state needs, and each state a cost, the length of its shortest
path to the goal. A branch that acts from a shape costs 1/p and then what its end's state costs. An
arranging branch costs itself, and may leave a better shape than the best there is: what it saves is
the mean over what arranging brought so far. The cheapest branch is grown. From a tight shape p
falls with every failure, until it is cheaper to arrange it, to take another shape, or to go back
and grow a roomier one from its parent.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import networkx as nx
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
"""Prior mean of an edge of which no shape has been valued, and of keeping a state."""
INHERITED = 0.5
"""Share of its parent's tries that speak for an arranged shape: it is much alike."""
GAINS = (0.5, 1.0, 2.0)
"""Values after arranging, relative to what was promised, until it was seen."""
REMEMBERED = 64
"""Gains of a state that are kept, the last ones."""


@dataclass(eq=False)
class Pool:
    """All shapes of one state, and what is known of its E edges.

    Attributes:
        edges: of the state in the solution DAG.
        nodes: N shapes.
        tries: (2, E) branches from all of them; see `branches.ACT` and `ARRANGE`.
        successes: (2, E) those that succeeded.
        promised: (E,) successes that the values promised of those that acted.
        gains: what arranging made of the value it promised, where it kept the state.
    """

    edges: tuple[Edge, ...]
    nodes: list[Node] = field(default_factory=list)
    gains: list[float] = field(default_factory=lambda: list(GAINS))
    tries: NDArray[np.float64] = field(init=False)
    successes: NDArray[np.float64] = field(init=False)
    promised: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        """Nothing was tried yet."""
        self.tries, self.successes = np.zeros((2, 2, len(self.edges)))
        self.promised = np.zeros(len(self.edges))

    @property
    def ratio(self) -> NDArray[np.float64]:
        """(E,) successes for each promised one."""
        return (TRUST + self.successes[ACT]) / (TRUST + self.promised)

    def chances(self) -> NDArray[np.float64]:
        """(N, E) posterior mean of acting from each shape along each edge."""
        prior = _prior(np.array([node.values for node in self.nodes]), self.ratio)
        tries = np.array([node.tries[ACT] for node in self.nodes])
        successes = np.array([node.successes[ACT] for node in self.nodes])
        return _posterior(prior, tries, successes)

    def lengths(self) -> NDArray[np.float64]:
        """(E,) expected branches along each edge from a fresh shape of this state."""
        # One shape of unknown value among them keeps a single bad shape from condemning a state.
        chances = np.vstack([_prior(np.full(len(self.edges), UNKNOWN), self.ratio), self.chances()])
        return 1.0 / chances.mean(axis=0)

    def costs(self, onward: NDArray, arranging: int) -> NDArray[np.float64]:
        """(2, N, E) expected branches to the goal by acting, or arranging, at each node and edge.

        Args:
            onward: (E,) expected branches from the state at the end of each edge.
            arranging: most arranging steps in a row.
        """
        act = 1.0 / self.chances()  # (N, E)
        best = act.min(axis=0)  # (E,)
        tries = np.array([node.tries for node in self.nodes])  # (N, 2, E)
        successes = np.array([node.successes for node in self.nodes])
        promise = np.array([node.arranged_values for node in self.nodes])
        # (N, E, gains): the chance of acting afterwards, if the state is kept.
        arranged = _posterior(
            _prior(promise[..., None] * np.array(self.gains), self.ratio[:, None]),
            INHERITED * tries[:, ACT, :, None],
            INHERITED * successes[:, ACT, :, None],
        )
        saved = np.maximum(best[:, None] - 1.0 / arranged, 0.0).mean(axis=-1)
        kept = self.successes[ARRANGE].sum() + TRUST * UNKNOWN
        kept /= self.tries[ARRANGE].sum() + TRUST
        keeps = _posterior(kept, tries[:, ARRANGE], successes[:, ARRANGE])
        arrange = 1.0 + best - keeps * saved
        arrange[[node.arranged >= arranging for node in self.nodes]] = np.inf
        return np.stack([act, arrange]) + onward


class PosteriorRule:
    """Grows the cheapest branches; a batch counts its own unfinished ones as failures so far."""

    def __init__(self, config: PlannerConfig, dag: SolutionDag) -> None:
        self._arranging, self._dag = config.arranging, dag
        self._pools: dict[TopologicalState, Pool] = {}

    def choose(self, count: int) -> list[Branch]:
        """The branches with the least expected costs."""
        ahead = self._ahead()
        onward = {
            state: np.array([ahead[next_state] for _, next_state in pool.edges])
            for state, pool in self._pools.items()
        }
        costs = {
            state: pool.costs(onward[state], self._arranging) for state, pool in self._pools.items()
        }
        chosen = []
        for _ in range(count):
            state = min(costs, key=lambda state: costs[state].min())
            pool = self._pools[state]
            place = np.unravel_index(costs[state].argmin(), costs[state].shape)
            kind, row, edge = map(int, place)
            chosen.append(Branch(pool.nodes[row], edge, kind))
            pool.nodes[row].tries[kind, edge] += 1
            costs[state] = pool.costs(onward[state], self._arranging)
        return chosen

    def add(self, node: Node) -> None:
        """Put a node into the pool of its state, with part of its parent's evidence if arranged."""
        if not node.edges:
            return
        self._pools.setdefault(node.state, Pool(node.edges)).nodes.append(node)
        if node.arranged and node.parent is not None:
            node.tries[ACT] = INHERITED * node.parent.tries[ACT]
            node.successes[ACT] = INHERITED * node.parent.successes[ACT]

    def learn(self, branch: Branch, child: Node | None) -> None:
        """Hold the outcome of a branch against what was promised."""
        node, edge, kind = branch.node, branch.edge, branch.kind
        pool = self._pools[node.state]
        success = child is not None and child.state == branch.goal
        node.successes[kind, edge] += success
        pool.tries[kind, edge] += 1
        pool.successes[kind, edge] += success
        if kind == ACT:
            pool.promised[edge] += np.clip(node.values[edge], LEAST_VALUE, MOST_VALUE)
        elif child is not None and success:
            gain = child.values[edge] / max(node.arranged_values[edge], LEAST_VALUE)
            pool.gains = [*pool.gains, float(gain)][-REMEMBERED:]

    def _ahead(self) -> dict[TopologicalState, float]:
        """Expected branches from a fresh shape of each state of the solution DAG to the goal."""
        lengths = {
            (state, onward, str(action)): length
            for state, pool in self._pools.items()
            for (action, onward), length in zip(pool.edges, pool.lengths(), strict=True)
        }

        def shortest(onward: TopologicalState, state: TopologicalState, edges: dict) -> float:
            return min(lengths.get((state, onward, key), 1.0 / UNKNOWN) for key in edges)

        backward = self._dag.graph.reverse(copy=False)
        found = nx.multi_source_dijkstra_path_length(
            backward, set(self._dag.goals), weight=shortest
        )
        return dict(found)


def _prior(values: NDArray, ratio: NDArray) -> NDArray[np.float64]:
    return np.clip(np.maximum(values, LEAST_VALUE) * ratio, LEAST_VALUE, MOST_VALUE)


def _posterior(prior: NDArray | float, tries: NDArray, successes: NDArray) -> NDArray[np.float64]:
    return np.asarray((TRUST * prior + successes) / (TRUST + tries))
