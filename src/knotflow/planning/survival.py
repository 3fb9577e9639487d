"""A search that continues until a plan ties in most of many simulated worlds.

Beyond the paper. A plan is executed open loop in several worlds (`simulation.worlds`): each spline
as it was planned, whatever the rope did. A world is lost once its rope is in another state than
planned. The nodes of the tree carry their ropes in all worlds, so that plans share what they have
in common, and the tree grows where the product of survival and value is highest.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.certainty import SurvivalConfig
from knotflow.planning.plan import STOPPED, KnotPlan, PlanStep
from knotflow.planning.proposals import prospect
from knotflow.planning.rules import Expansion, Node
from knotflow.planning.tree import Progress, SearchStoppedError, TreeSearch
from knotflow.simulation import RopeSimulator, World, draw_worlds, end_states
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats

ROPES = 8
"""In so many of a node's ropes, splines are expected to succeed, before any is simulated."""
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
        self,
        search: TreeSearch,
        config: SurvivalConfig,
        rng: np.random.Generator,
        early: bool = False,
    ) -> None:
        """`search` has not begun. If `early`, a plan is not tested in worlds that can no longer
        make it unsure."""
        self._search, self._config, self._rng, self._early = search, config, rng, early
        self._worlds: list[World] = []
        self._lost = np.zeros(config.worlds, int)
        root = search.nodes[0]
        self._ropes = {root: Ropes.alike(root.points, config.worlds)}
        self._children: defaultdict[tuple[Node, TopologicalState], list[Node]] = defaultdict(list)
        """Simulated nodes by parent and state."""
        self._tries: Counter[tuple[Node, int]] = Counter()

    def run(self, progress: Progress | None = None, stoppable: bool = False) -> KnotPlan:
        """The plan that survives best; how often is measured in fresh worlds.

        `SearchStoppedError` and, if `stoppable`, Ctrl-C end the search with the best plan so far,
        and go on to the caller before there is one. While it is measured, they leave it without
        `worlds`. The measurement may pass the limits of the search; a test of a plan that has begun
        may pass that of splines.
        """
        stops = (SearchStoppedError, KeyboardInterrupt) if stoppable else SearchStoppedError
        search, config = self._search, self._config
        first = search.run(progress)
        if not (first.solved and first.steps):
            return first
        self._worlds, best = self._draw(), search.nearest()
        reason = f"it ties in at least {100 * config.least:g} % of {3 * config.worlds} worlds"
        try:
            self._simulate(best.path())
            while not self._is_sure(best):
                if (spent := search.spent()) is not None:
                    reason = spent
                    break
                self._simulate(self._next(self._ropes[best].survival))
                tied = [node for node in self._ropes if node.distance == 0]
                tied.sort(key=lambda node: self._ropes[node].survival, reverse=True)
                best = next(node for node in tied if search.reaches(node))  # the first plan is
                if progress is not None:
                    update = search.update()
                    progress(replace(update, survival=self._ropes[best].survival))
        except stops:
            reason = STOPPED
        plan = search.plan(True, reason, best)
        try:
            survived = surviving(plan.steps, search.simulator, self._draw())
        except stops:
            return replace(plan, seconds=search.elapsed())
        return replace(plan, worlds=config.worlds, survived=survived, seconds=search.elapsed())

    def _is_sure(self, tied: Node) -> bool:
        """Whether a plan ties in most worlds, and in most of twice as many others: the best of many
        was lucky in the worlds it was chosen by."""
        config = self._config
        if self._search.is_late():
            return False
        ropes = self._ropes[tied]
        if ropes.survival < config.least:
            return False
        steps, others = self._search.plan(True, "", tied).steps, self._draw() + self._draw()
        lost, sure = (1 - ropes.survival) * config.worlds, False
        most = (1 - config.least) * 3 * config.worlds
        tested = config.worlds
        for first in range(0, len(others), config.screened):
            some = others[first : first + config.screened]
            left = surviving(steps, self._search.simulator, some)
            self._search.branches += len(some) + sum(left[:-1])
            tested, lost = tested + len(some), lost + len(some) - left[-1]
            untested = 3 * config.worlds - tested
            sure = lost + untested <= most and (self._early or not untested)
            if sure or lost > most or self._search.is_late():
                break
        self._ropes[tied] = replace(ropes, survival=1 - lost / tested)
        return bool(sure)

    def _draw(self) -> list[World]:
        rope, config = self._search.simulator.config.rope, self._config
        catches = self._search.catches
        return draw_worlds(rope, config.worlds, self._rng, config.spread, catches)

    def _next(self, known: float) -> Sequence[Node]:
        """The best new children of the most promising node that survives in more than a share of
        the worlds, for no plan survives in more of them than its steps."""
        search = self._search

        def promise(node: Node, edge: int) -> float:
            tries, value = self._tries[node, edge], float(node.values[edge])
            before = self._ropes[node].survival
            if tries and before and (best := self._best_child(node, edge)) is not None:
                value = (value + tries * self._ropes[best].survival / before) / (1 + tries)
            return before * value * STEP**node.distance / math.sqrt(1 + tries)

        better = [node for node, ropes in self._ropes.items() if ropes.survival > known]
        pairs = [(node, edge) for node in better for edge in range(len(node.edges))]
        node, edge = max(pairs, key=lambda pair: promise(*pair))
        best = self._best_child(node, edge)
        near = best.step.spline if best is not None and best.step is not None else None
        self._tries[node, edge] += 1
        ropes = self._ropes[node]
        some = ropes.points[ropes.intact][:ROPES]
        children = search.grow_for(Expansion(node, edge), some, near, self._config.batch)
        return sorted(children, key=prospect)[-self._config.tested :]

    def _best_child(self, node: Node, edge: int) -> Node | None:
        """The child by an edge that survives best."""
        children = self._children[node, node.edges[edge][1]]
        return max(children, key=lambda one: self._ropes[one].survival, default=None)

    def _simulate(self, nodes: Sequence[Node]) -> None:
        """Carry ropes to nodes, each after its parent."""
        for node in nodes:
            parent, step = node.parent, node.step
            if parent is None or step is None or node in self._ropes:
                continue
            if self._search.is_late():
                return
            self._ropes[node] = self._execute(step, self._ropes[parent])
            self._children[parent, node.state].append(node)

    def _execute(self, step: PlanStep, before: Ropes) -> Ropes:
        """Execute a step in the worlds that are not lost, those that lose most ropes first, and
        a few at a time, for as long as no more than one is lost."""
        rows, simulator = np.flatnonzero(before.intact), self._search.simulator
        rows = rows[np.argsort(-self._lost[rows], kind="stable")]
        points, intact = before.points.copy(), np.zeros_like(before.intact)
        tested = 0
        for first in range(0, len(rows), self._config.screened):
            if intact.sum() < tested - 1:
                break
            some = rows[first : first + self._config.screened]
            chosen = np.isin(np.arange(len(intact)), some)
            after = _execute(step, replace(before, intact=chosen), self._worlds, simulator)
            points[some], intact = after.points[some], intact | after.intact
            self._lost[some] += ~after.intact[some]
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
    if not len(rows):
        return before
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
