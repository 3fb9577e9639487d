"""A search that continues until a plan ties in most of many simulated worlds.

Beyond the paper. A plan is executed open loop in several worlds (`simulation.worlds`): each spline
as it was planned, whatever the rope did. A world is lost once its rope is in another state than
planned. The nodes of the tree carry their ropes in all worlds, so that plans share what they have
in common, and the tree grows where the product of survival and value is highest.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.certainty import SurvivalConfig
from knotflow.planning.plan import KnotPlan, PlanStep
from knotflow.planning.proposals import clearance
from knotflow.planning.rules import Expansion, Node
from knotflow.planning.tree import Progress, TreeSearch
from knotflow.simulation import RopeSimulator, World, draw_worlds, end_states
from knotflow.topology.polyline import Floats

STEP = 0.7
"""Share of worlds that a step not yet planned is expected to survive."""


@dataclass(frozen=True)
class Ropes:
    """A node's rope in W worlds: (W, V, 3), metres, whether it is in the node's state, and the
    share of worlds in which it would be, as far as is known."""

    points: Floats
    intact: NDArray[np.bool_]
    survival: float = 1.0

    @classmethod
    def alike(cls, points: Floats, worlds: int) -> Ropes:
        """One rope (V, 3), metres, in all worlds."""
        return cls(np.repeat(points[None], worlds, axis=0), np.ones(worlds, bool))


class SurvivalSearch:
    """A tree search that goes on after its first plan."""

    def __init__(
        self, search: TreeSearch, config: SurvivalConfig, rng: np.random.Generator
    ) -> None:
        """`search` has not begun."""
        self._search, self._config, self._rng = search, config, rng
        self._worlds: list[World] = []
        root = search.nodes[0]
        self._ropes = {root: Ropes.alike(root.points, config.worlds)}
        self._tries: Counter[tuple[Node, int]] = Counter()

    def run(self, progress: Progress | None = None) -> KnotPlan:
        """The plan that survives best; how often is measured in fresh worlds."""
        search, config = self._search, self._config
        first = search.run(progress)
        if not (first.solved and first.steps):
            return first
        self._worlds, best = self._draw(), search.nearest()
        self._simulate(best.path())
        reason = f"it ties in at least {100 * config.least:g} % of {config.worlds} worlds"
        while self._ropes[best].survival < config.least:
            if (spent := search.spent()) is not None:
                reason = spent
                break
            self._simulate(self._next())
            tied = [node for node in self._ropes if node.distance == 0]
            tied.sort(key=lambda node: self._ropes[node].survival, reverse=True)
            best = next(node for node in tied if search.reaches(node))  # the first plan is
            if progress is not None:
                update = search.update()
                progress(replace(update, survival=self._ropes[best].survival))
        plan = search.plan(True, reason, best)
        survived = surviving(plan.steps, search.simulator, self._draw())
        return replace(plan, worlds=config.worlds, survived=survived, seconds=search.elapsed())

    def _draw(self) -> list[World]:
        rope, config = self._search.simulator.config.rope, self._config
        return draw_worlds(rope, config.worlds, self._rng, config.spread)

    def _next(self) -> Sequence[Node]:
        """The best new children of the most promising node."""
        search = self._search

        def promise(node: Node, edge: int) -> float:
            tied = self._ropes[node].survival * float(node.values[edge]) * STEP**node.distance
            return tied / math.sqrt(1 + self._tries[node, edge])

        pairs = [(node, edge) for node in self._ropes for edge in range(len(node.edges))]
        node, edge = max(pairs, key=lambda pair: promise(*pair))
        self._tries[node, edge] += 1
        known = len(search.nodes)
        search.grow([Expansion(node, edge)] * self._config.batch)
        children = [one for one in search.nodes[known:] if one.state == node.edges[edge][1]]
        return sorted(children, key=_prospect)[-self._config.tested :]

    def _simulate(self, nodes: Sequence[Node]) -> None:
        """Carry ropes to nodes, each after its parent."""
        for node in nodes:
            parent, step = node.parent, node.step
            if parent is None or step is None or node in self._ropes:
                continue
            self._ropes[node] = self._execute(step, self._ropes[parent])

    def _execute(self, step: PlanStep, before: Ropes) -> Ropes:
        """Execute a step in the worlds that are not lost; in a few alone if it fails there."""
        rows, simulator = np.flatnonzero(before.intact), self._search.simulator
        points, intact = before.points.copy(), np.zeros_like(before.intact)
        tested = 0
        for some in (rows[: self._config.screened], rows[self._config.screened :]):
            if not len(some) or (tested and intact.sum() < tested - 1):
                break
            chosen = np.isin(np.arange(len(intact)), some)
            after = _execute(step, replace(before, intact=chosen), self._worlds, simulator)
            points[some], intact = after.points[some], intact | after.intact
            tested += len(some)
        self._search.branches += tested
        return Ropes(points, intact, before.survival * float(intact.sum()) / max(tested, 1))


def surviving(
    steps: Sequence[PlanStep], simulator: RopeSimulator, worlds: Sequence[World]
) -> tuple[int, ...]:
    """In how many worlds a plan, executed open loop, is in the planned state after each step."""
    left, ropes = [], Ropes.alike(steps[0].start, len(worlds))
    for step in steps:
        ropes = _execute(step, ropes, worlds, simulator)
        left.append(int(ropes.intact.sum()))
    return tuple(left)


def _execute(
    step: PlanStep, before: Ropes, worlds: Sequence[World], simulator: RopeSimulator
) -> Ropes:
    """Execute a step blindly in the worlds that are not lost."""
    rows = np.flatnonzero(before.intact)
    points, intact = before.points.copy(), before.intact.copy()
    controls = step.controls(simulator.config.rope.radius)
    rollouts = simulator.execute(
        points[rows],
        np.repeat(step.spline[None], len(rows), axis=0),
        [worlds[row] for row in rows.tolist()],
        np.repeat(controls[None], len(rows), axis=0),
    )
    points[rows] = rollouts.end_points
    intact[rows] = [end == step.end_state for end in end_states(rollouts)]
    return Ropes(points, intact)


def _prospect(node: Node) -> float:
    """How promising a node is before it is simulated in any world."""
    return clearance(node.points) * float(node.values.max(initial=0.0) if node.edges else 1.0)
