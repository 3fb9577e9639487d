"""Tree search over rope shapes and their topological states (paper Sec. V-B d).

At each expansion a node of the tree is chosen, leaf or not, and an outgoing edge of its state in
the solution DAG. The sampler proposes a spline for the edge's action, the simulator executes it,
and the end shape becomes a node if it has exactly the state that the action leads to. The search
ends when a goal state is reached. Which branch is grown is a rule's business: the paper's is in
`planning.growth`, the default one in `planning.posterior`.

Beyond the paper, a branch may also be for a spline that keeps the state and makes room for the
edge's action (Sec. VIII). And where a branch fails, its end is kept all the same if it is of use:
in the state at the end of another edge, or in the state it began in, as a further shape of it.
With an ensemble (`planning.ensemble`) the search goes on from a plan that few perturbed ropes
execute to better ones. With a margin no end is kept whose strands only just cross. And a plan that
hangs by the time step is none where it shall be `steady`.

With `batch` above 1 as many expansions are chosen by the same rule from the tree as it stands, and
simulated at once. Every plan found is as valid as one found one by one; the tree is somewhat
larger, because the choices of a batch do not know of each other's outcomes.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import (
    DIVERGED,
    FRAGILE,
    UNREADABLE,
    Branch,
    Node,
    Progress,
    Rule,
    SearchUpdate,
    Simulator,
    by_action,
    steps_to,
)
from knotflow.planning.config import PlannerConfig
from knotflow.planning.ensemble import Ensemble
from knotflow.planning.goals import Goal
from knotflow.planning.growth import PaperRule
from knotflow.planning.plan import KnotPlan, PlanStep, Tried
from knotflow.planning.posterior import PosteriorRule
from knotflow.planning.proposals import Proposals, together
from knotflow.planning.search_graph import SearchGraph
from knotflow.planning.soundness import are_steady
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import Observer, Rollouts, check_points, end_states
from knotflow.topology import Action, Arrange, TopologicalState, segment_lengths

PART = 4
"""Branches that are simulated as soon as they are sampled, while others are."""


@dataclass(eq=False)
class _Clock:
    """Where the seconds of a search go."""

    began: float = field(default_factory=time.perf_counter)
    sampling: float = 0.0
    simulation: float = 0.0

    @property
    def seconds(self) -> float:
        return time.perf_counter() - self.began


class TreeSearch:
    """A tree in the making; `run` grows it until the goal is reached or a budget is spent."""

    def __init__(
        self,
        points: NDArray,
        goal: Goal,
        sampler: Sampler,
        simulator: Simulator,
        rng: np.random.Generator,
        config: PlannerConfig | None = None,
        observe: Observer | None = None,
    ) -> None:
        """Plant the root: see `plan_knot` for the arguments and errors."""
        self.goal, self.simulator = goal, simulator
        self.config, self.observe = config or PlannerConfig(), observe
        points = check_points(points, simulator.config.rope)
        state = TopologicalState.from_curve(points)
        self._paper = self.config.rule == "paper"
        undoing = self.config.undoing or not (self._paper or state.num_crossings == 0)
        self._dag = SearchGraph(goal.dag, state) if undoing else goal.dag
        self._proposals = Proposals(sampler, goal, self.config, rng)
        self._rule: Rule = (
            PaperRule(self.config, rng) if self._paper else PosteriorRule(self.config, self._dag)
        )
        self.nodes = [self._node(points, state)]
        self._ensemble: Ensemble | None = None
        if self.config.ensemble:
            self._ensemble = Ensemble(simulator.config, self.config, rng.spawn(1)[0])
            self._ensemble.lay(self.nodes[0])
        self.branches = 0
        self.tried: Counter[tuple[TopologicalState, Action, str, bool]] = Counter()
        self._clock = _Clock()

    def expand(self, count: int) -> SearchUpdate:
        """Choose, sample and simulate `count` branches, and add those whose ends are kept."""
        chosen = together(self._rule.choose(count))
        splines, rollouts = self._simulated(chosen)
        ends = end_states(rollouts)
        children = [
            self._judge(branch, splines[row], rollouts, row, ends[row])
            for row, branch in enumerate(chosen)
        ]
        children = self._robust(children)
        self._count(chosen, children, ends, rollouts)
        new = [child for child in children if child is not None]
        self._appraise(new)
        for branch, child in zip(chosen, children, strict=True):
            self._rule.learn(branch, child)
        self._add(new)
        self.branches += count
        if self.observe is not None:
            for attempts in by_action(chosen, splines, rollouts, ends):
                self.observe(attempts)
        nearest = min(node.distance for node in self.nodes)
        return SearchUpdate(self.branches, len(self.nodes), nearest, self._clock.seconds)

    def run(self, progress: Progress | None = None) -> KnotPlan:
        """Grow the tree; see `plan_knot`."""
        config = self.config
        self._clock = _Clock()
        self._appraise(self.nodes)
        self._add([self.nodes.pop()])
        reason = ""
        while not reason:
            tied = self._tied()
            if tied and self._suffices():
                return self._plan(solved=True, reason=self._success())
            if self.branches >= config.max_branches:
                reason = f"{config.max_branches} branches were simulated"
            elif self._clock.seconds >= config.max_seconds:
                reason = f"{config.max_seconds:g} s passed"
            else:
                update = self.expand(min(config.batch, config.max_branches - self.branches))
                if progress is not None:
                    progress(update)
        if not tied:
            return self._plan(solved=False, reason=f"{reason} without reaching the goal")
        return self._plan(solved=True, reason=f"{self._success()}; {reason}")

    def _success(self) -> str:
        if not self.branches:
            return "the rope was tied already"
        reached = "the goal was reached"
        if self._ensemble is None:
            return reached
        return f"{reached}, and by {self._nearest().left} of {self.config.ensemble} perturbed ropes"

    def _suffices(self) -> bool:
        """Whether the best plan is robust enough; if not, only more robust ones are sought."""
        best = self._nearest()
        if self._ensemble is None or self._ensemble.suffices(best):
            return True
        if not self._ensemble.falls_short(best):  # which it does once it was surpassed
            self._ensemble.surpass(best)
            self._rule.drop([node for node in self.nodes if self._ensemble.falls_short(node)])
        return False

    def _simulated(self, chosen: Sequence[Branch]) -> tuple[NDArray[np.float64], Rollouts]:
        """Splines (B, 6) for the branches, and what comes of them.

        Sampling keeps one core busy; the others simulate what was sampled so far.
        """
        clock = time.perf_counter()
        proposed: list[NDArray[np.float64]] = []
        results: list[Future[Rollouts]] = []
        begin = end = 0
        with ThreadPoolExecutor(1) as worker:
            for splines in self._proposals.splines(chosen):
                proposed.append(splines)
                end += len(splines)
                if end - begin >= PART or end == len(chosen):
                    starts = np.stack([branch.node.points for branch in chosen[begin:end]])
                    part = np.concatenate(proposed)[begin:]
                    results.append(worker.submit(self.simulator.execute, starts, part))
                    begin = end
            self._clock.sampling += time.perf_counter() - clock
            clock = time.perf_counter()
            rollouts = Rollouts.joined([result.result() for result in results])
            self._clock.simulation += time.perf_counter() - clock
        return np.concatenate(proposed), rollouts

    def _node(
        self,
        points: NDArray,
        state: TopologicalState,
        parent: Node | None = None,
        step: PlanStep | None = None,
    ) -> Node:
        dag = self._dag
        return Node(points, state, dag.distance(state), dag.edges_from(state), parent, step)

    def _appraise(self, nodes: Sequence[Node]) -> None:
        clock = time.perf_counter()
        self._proposals.appraise(nodes)
        self._clock.sampling += time.perf_counter() - clock

    def _add(self, nodes: Sequence[Node]) -> None:
        self.nodes.extend(nodes)
        for node in nodes:
            self._rule.add(node)

    def _judge(
        self,
        branch: Branch,
        spline: NDArray,
        rollouts: Rollouts,
        row: int,
        state: TopologicalState | None,
    ) -> Node | None:
        """The node that a branch's end is worth, if any."""
        node = branch.node
        action = branch.action if state == branch.goal else self._done(branch, state)
        if state is None or action is None:
            return None
        if self._tight(rollouts.end_points[row], node.points):
            return None
        step = PlanStep(
            action=action,
            spline=spline.copy(),
            start=node.points,
            start_state=node.state,
            end=rollouts.end_points[row].copy(),
            end_state=state,
            times=rollouts.times,
            trajectory=rollouts.trajectory[row].copy(),
            gripper=rollouts.gripper[row].copy(),
        )
        return self._node(step.end, state, node, step)

    def _tight(self, end: NDArray, start: NDArray) -> bool:
        """Whether a segment of the rope (V, 3) is left shorter than the margin and than before."""
        margin = self.config.margin / self.simulator.config.rope.length

        def shortest(points: NDArray) -> float:
            return float(segment_lengths(points).min())

        # Each reading of a shape's crossings takes time: none without a margin, one where it holds.
        return margin > 0 and (left := shortest(end)) < margin and left < shortest(start)

    def _robust(self, children: list[Node | None]) -> list[Node | None]:
        """The children without those that too few ropes of the ensemble reach."""
        new = [child for child in children if child is not None]
        if self._ensemble is None or not new:
            return children
        clock = time.perf_counter()
        kept = self._ensemble.survivors(new)
        self._clock.simulation += time.perf_counter() - clock
        return [child if child in kept else None for child in children]

    def _count(
        self,
        chosen: Sequence[Branch],
        children: Sequence[Node | None],
        ends: Sequence[TopologicalState | None],
        rollouts: Rollouts,
    ) -> None:
        """Take down what became of each branch."""
        for row, (branch, child, state) in enumerate(zip(chosen, children, ends, strict=True)):
            reached = state == branch.goal
            lost = DIVERGED if rollouts.diverged[row] else UNREADABLE
            outcome = lost if state is None else str(state)
            if reached and child is None:
                outcome = FRAGILE
            success = reached and child is not None
            self.tried[branch.node.state, branch.action, outcome, success] += 1

    def _done(self, branch: Branch, state: TopologicalState | None) -> Action | None:
        """What a branch that failed did instead, if that is of use; never by the paper's rule."""
        if self._paper:
            return None
        if state == branch.node.state:
            room = branch.node.arranged < self.config.arranging
            return Arrange(branch.wanted) if room else None
        return next((action for action, end in branch.node.edges if end == state), None)

    def _tied(self) -> bool:
        """Whether a goal state is reached; what hangs by the time step is forgotten."""
        while (best := self._nearest()).distance == 0:
            unproven = [node for node in best.way() if not node.steady]
            if not (self.config.steady and unproven):
                return True
            clock = time.perf_counter()
            found = are_steady(steps_to(unproven), self.simulator.config)
            self._clock.simulation += time.perf_counter() - clock
            for node, steady in zip(unproven, found, strict=True):
                node.steady = steady
            if all(found):
                return True
            first = unproven[found.index(False)]
            below = [node for node in self.nodes if first in node.way()]
            self.nodes = [node for node in self.nodes if node not in below]
            self._rule.drop(below)
        return False

    def _nearest(self) -> Node:
        """The goal's node, or that which came nearest; the most robust, then the shortest."""
        return min(self.nodes, key=lambda node: (node.distance, -node.survival, len(node.way())))

    def _plan(self, solved: bool, reason: str) -> KnotPlan:
        best = self._nearest()
        root, simulation = self.nodes[0], self.simulator.config
        return KnotPlan(
            goal=self.goal.name,
            goal_states=tuple(sorted(self.goal.states)),
            solved=solved,
            reason=reason,
            start=root.points,
            start_state=root.state,
            steps=best.steps(),
            tried=tuple(
                Tried(state, action, outcome, success, count)
                for (state, action, outcome, success), count in self.tried.items()
            ),
            branches=self.branches,
            nodes=len(self.nodes),
            seconds=self._clock.seconds,
            sampling_seconds=self._clock.sampling,
            simulation_seconds=self._clock.simulation,
            radius=simulation.rope.radius,
            move_time=simulation.move_time,
        )


def plan_knot(
    points: NDArray,
    goal: Goal,
    sampler: Sampler,
    simulator: Simulator,
    rng: np.random.Generator,
    config: PlannerConfig | None = None,
    progress: Progress | None = None,
    observe: Observer | None = None,
) -> KnotPlan:
    """Plan how to tie a knot into a rope as it lies (Sec. V-B d).

    The same rng gives the same plan for the same batch size, unless `max_seconds` ends it.

    Args:
        points: (V, 3) the rope at rest, metres, in any state. Crossings that it has may be undone;
            by the paper's rule only if `undoing` is set.
        goal: what to tie.
        sampler: proposes splines.
        simulator: executes them.
        rng: everything random comes from it.
        config: rule, batch size and budgets.
        progress: called after every batch.
        observe: called with every batch's attempts, one action and start state at a time; their
            rollouts are all that the search simulates.

    Returns:
        The plan; one that is not solved holds the steps to the node nearest to the goal, what was
        tried, and why the search stopped.

    Raises:
        UnreachableGoalError: no actions lead from the rope's state to the goal.
        ShapeError: points that are not a shape of the simulator's rope.
        DegenerateCurveError: the projection of the rope does not determine its state.

    Warns:
        UnlikeRopeWarning: a trained sampler has learned with a rope of another size.
    """
    search = TreeSearch(points, goal, sampler, simulator, rng, config, observe)
    if (warn := getattr(sampler, "warn_if_unlike", None)) is not None:
        warn(simulator.config.rope)
    return search.run(progress)
