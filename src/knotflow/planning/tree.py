"""Tree search over rope shapes and their topological states (paper Sec. V-B d).

A rule (`planning.rules`) chooses a node of the tree, leaf or not, and an outgoing edge of its state
in the solution DAG. The sampler proposes a spline for the edge's action, the simulator executes it,
and the end shape becomes a node if it has the state that the action leads to.

The ends of other splines are kept where they are of use. By the paper's rule, as in its authors'
code, these are all in the solution DAG that are no farther from the goal: a spline that keeps the
state makes a further shape of it, and one may pass several states at once. By the posterior rule
they are those in the state of another edge, and a few that keep the state. Beyond the paper, a
spline may also be meant to keep the state and make room for the edge's action (Sec. VIII).
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from knotflow.planning.config import PlannerConfig
from knotflow.planning.goals import Goal
from knotflow.planning.hand import Hand, Reach
from knotflow.planning.plan import OUT_OF_REACH, ExpansionStats, KnotPlan, PlanStep
from knotflow.planning.proposals import Proposals, group_by_query, prospect
from knotflow.planning.rules import KINDS, Expansion, Node, PaperRule, PosteriorRule
from knotflow.planning.validation import are_robust
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import (
    GRASP_REACH,
    Attempts,
    Observer,
    Rollouts,
    RopeSimulator,
    check_points,
    clip_splines,
    end_states,
)
from knotflow.topology import Action, Arrange, TopologicalState, segment_lengths
from knotflow.topology.polyline import Floats

DIVERGED, UNREADABLE = "diverged", "unreadable"
"""Outcomes without a state: the simulation diverged, or the projection is degenerate."""
FRAGILE = "fragile"
"""Outcome of an expansion that reached its state with segments shorter than the margin."""
COPIES = 8
"""Splines tried for each step of an earlier plan."""
CHUNK = 4
"""Expansions that are simulated as soon as they are sampled, while others are."""


@dataclass(frozen=True)
class SearchUpdate:
    """What a search reports after each batch."""

    branches: int  # splines simulated so far
    kept: int  # of their ends, in the tree
    distance: int  # edges from the nearest node to the goal; 0 when solved
    seconds: float  # wall time so far
    survival: float = 0.0  # share of worlds in which the best plan ties; see `planning.survival`


Progress = Callable[[SearchUpdate], None]
"""What it raises ends a search; see `SearchStoppedError`."""


class SearchStoppedError(Exception):
    """Raised by a `Progress` that wants what was found so far, if a plan was."""


class TreeSearch:
    """A tree in the making; `run` grows it until the goal is reached or a budget is spent."""

    def __init__(
        self,
        points: Floats,
        goal: Goal,
        sampler: Sampler,
        simulator: RopeSimulator,
        rng: np.random.Generator,
        config: PlannerConfig | None = None,
        observe: Observer | None = None,
        reach: Reach | None = None,
        earlier: KnotPlan | None = None,
    ) -> None:
        """Create the root: see `plan_knot` for the arguments and errors."""
        self.goal, self.simulator = goal, simulator
        self.config, self.observe = config or PlannerConfig(), observe
        self._reach, self._earlier = reach, earlier
        self.catches = reach.catches if isinstance(reach, Hand) else GRASP_REACH
        points = check_points(points, simulator.config.rope)
        state = TopologicalState.from_curve(points)
        self._paper = self.config.rule == "paper"
        undoing = self.config.undoing or not (self._paper or state.num_crossings == 0)
        self._dag = goal.dag.with_undoings(state) if undoing else goal.dag
        if (for_rope := getattr(sampler, "for_rope", None)) is not None:
            sampler = for_rope(simulator.config.rope)
        self._proposals = Proposals(sampler, goal, self.config, rng, reach)
        self._rule = PaperRule(rng) if self._paper else PosteriorRule(self.config, self._dag)
        self.nodes = [self._node(points, state)]
        self.branches = self.kept = self.out_of_reach = 0
        self.tried: Counter[tuple[TopologicalState, Action, str, bool]] = Counter()
        self._began = time.perf_counter()

    def expand(self, count: int) -> SearchUpdate:
        """Choose, sample and simulate `count` expansions, and add those whose ends are kept."""
        chosen, splines, parts = self._simulate(group_by_query(self._rule.choose(count)))
        return self._add(chosen, splines, parts) if chosen else self.update()

    def grow_for(
        self, expansion: Expansion, ropes: Floats, near: Floats | None, count: int
    ) -> list[Node]:
        """As `expand`, with splines that suit several ropes, see `Proposals.for_worlds`; the new
        nodes in the expansion's state."""
        splines = self._proposals.for_worlds(expansion, ropes, near, count)
        for _ in range(count - len(splines)):
            self._miss(expansion)
        return self._grow_by(expansion, splines)

    def _grow_by(self, expansion: Expansion, splines: Floats, learn: bool = True) -> list[Node]:
        """Simulate splines (B, 6) of one expansion; the new nodes in its state."""
        if not len(splines):
            return []
        count = len(self.nodes)
        starts = np.repeat(expansion.node.points[None], len(splines), axis=0)
        rollouts = self.simulator.execute(starts, splines)
        self._add([expansion] * len(splines), splines, [rollouts], learn)
        return [one for one in self.nodes[count:] if one.state == expansion.goal]

    def _follow(self, plan: KnotPlan) -> None:
        """Grow a branch by what is left of an earlier plan for this rope: by noisy copies of each
        spline, from where the best ones of the step before ended. How copies of one spline fare
        says little of others, so the rule learns nothing from it."""
        node = self.nodes[0]
        for step in plan.steps_from(node.state):
            edges = range(len(node.edges))
            options = (Expansion(node, edge, kind) for kind in KINDS for edge in edges)
            expansion = next((one for one in options if one.action == step.action), None)
            if expansion is None or self.branches + COPIES > self.config.max_branches:
                return
            x, y, _ = (node.points - step.start).mean(axis=0)
            spline = clip_splines(step.spline + [0.0, x, y, 0.0, x, y])
            splines = self._proposals.near(node.points, spline, COPIES)
            children = self._grow_by(expansion, splines, learn=False)
            if not children:
                return
            node = max(children, key=prospect)

    def _add(
        self,
        chosen: Sequence[Expansion],
        splines: Floats,
        parts: Sequence[Rollouts],
        learn: bool = True,
    ) -> SearchUpdate:
        rollouts = Rollouts.concatenate(parts)
        ends = end_states(rollouts)
        children = [
            self._child(expansion, splines[row], rollouts, row, ends[row])
            for row, expansion in enumerate(chosen)
        ]
        for row, (expansion, child, end) in enumerate(zip(chosen, children, ends, strict=True)):
            reached, outcome = end == expansion.goal, str(end)
            if end is None:
                outcome = DIVERGED if rollouts.diverged[row] else UNREADABLE
            elif reached and child is None:
                outcome = FRAGILE
            success = reached and child is not None
            self.tried[expansion.node.state, expansion.action, outcome, success] += 1
        new = [child for child in children if child is not None]
        self._proposals.evaluate(new)
        if learn:
            for expansion, child in zip(chosen, children, strict=True):
                self._rule.learn(expansion, child)
        self.nodes.extend(new)
        for node in new:
            self._rule.add(node)
        self.branches += len(chosen)
        self.kept += len(new)
        if self.observe is not None:
            for attempts in _group_by_action(chosen, splines, rollouts, ends):
                self.observe(attempts)
        return self.update()

    def update(self) -> SearchUpdate:
        """How far the search has come."""
        nearest = min(node.distance for node in self.nodes)
        return SearchUpdate(self.branches, self.kept, nearest, self.elapsed())

    def run(self, progress: Progress | None = None) -> KnotPlan:
        """Grow the tree; see `plan_knot`."""
        config = self.config
        self._began = time.perf_counter()
        self._proposals.evaluate(self.nodes)
        self._rule.add(self.nodes[0])
        if self._earlier is not None:
            self._follow(self._earlier)
        while not self._is_tied():
            if (spent := self.spent()) is not None:
                return self.plan(False, spent)
            update = self.expand(min(config.batch, config.max_branches - self.branches))
            if progress is not None:
                progress(update)
        reason = "the goal was reached" if self.branches else "the rope was tied already"
        return self.plan(True, reason)

    def spent(self) -> str | None:
        """Which budget is spent, in words, if one is."""
        if self.branches >= self.config.max_branches:
            return f"{self.config.max_branches} splines were simulated"
        if self.out_of_reach >= self.config.max_branches:
            return f"{self.config.max_branches} times no spline was in the arm's reach"
        if self.is_late():
            return f"{self.config.max_seconds:g} s passed"
        return None

    def is_late(self) -> bool:
        """Whether its time is over."""
        return self.elapsed() >= self.config.max_seconds

    def elapsed(self) -> float:
        """Seconds since the search began."""
        return time.perf_counter() - self._began

    def _simulate(
        self, expansions: Sequence[Expansion]
    ) -> tuple[list[Expansion], Floats, list[Rollouts]]:
        """Those B with a spline in reach, splines (B, 6), and rollouts simulated meanwhile."""
        chosen: list[Expansion] = []
        proposed: list[Floats] = []
        results: list[Future[Rollouts]] = []
        begin = end = 0

        def simulate() -> None:
            nonlocal begin
            starts = np.stack([one.node.points for one in chosen[begin:]])
            part = np.stack(proposed[begin:])
            results.append(worker.submit(self.simulator.execute, starts, part))
            begin = len(chosen)

        with ThreadPoolExecutor(1) as worker:
            for splines in self._proposals.splines(expansions):
                for expansion, spline in zip(expansions[end:], splines, strict=False):
                    if np.isnan(spline).any():
                        self._miss(expansion)
                    else:
                        chosen.append(expansion)
                        proposed.append(spline)
                end += len(splines)
                if len(chosen) - begin >= CHUNK:
                    simulate()
            if len(chosen) > begin:
                simulate()
            return chosen, np.reshape(proposed, (-1, 6)), [one.result() for one in results]

    def _miss(self, expansion: Expansion) -> None:
        self.out_of_reach += 1
        self.tried[expansion.node.state, expansion.action, OUT_OF_REACH, False] += 1
        self._rule.learn(expansion, None)

    def _node(
        self,
        points: Floats,
        state: TopologicalState,
        parent: Node | None = None,
        step: PlanStep | None = None,
    ) -> Node:
        dag = self._dag
        return Node(points, state, dag.distance(state), dag.edges_from(state), parent, step)

    def _child(
        self,
        expansion: Expansion,
        spline: Floats,
        rollouts: Rollouts,
        row: int,
        state: TopologicalState | None,
    ) -> Node | None:
        """The node at the end of an expansion, if it is kept."""
        node = expansion.node
        action = expansion.action if state == expansion.goal else self._done(expansion, state)
        end = rollouts.end_points[row].copy()
        if state is None or action is None or self._is_fragile(end, node.points):
            return None
        step = PlanStep(
            action=action,
            spline=spline.copy(),
            start=node.points,
            start_state=node.state,
            end=end,
            end_state=state,
            **vars(rollouts.motion(row)),
        )
        return self._node(end, state, node, step)

    def _done(self, expansion: Expansion, state: TopologicalState | None) -> Action | None:
        """What a failed expansion did instead, if that is of use."""
        node, dag = expansion.node, self._dag
        if state == node.state:
            arranges = self._paper or node.num_arranging < self.config.arranging
            return Arrange(expansion.edge_action) if arranges else None
        done = next((action for action, end in node.edges if end == state), None)
        if done is not None or not self._paper or state is None or state not in dag:
            return done
        if dag.distance(state) > node.distance:
            return None
        others = (action for action, end in node.state.actions() if end == state)
        return next(others, expansion.edge_action)

    def _is_fragile(self, end: Floats, start: Floats) -> bool:
        """Whether a segment is shorter than the margin and than any before."""
        margin = self.config.margin / self.simulator.config.rope.length
        if margin == 0:  # reading the crossings takes time
            return False
        shortest = segment_lengths(end).min()
        return bool(shortest < margin and shortest < segment_lengths(start).min())

    def _is_tied(self) -> bool:
        """Whether a goal state is reached; drops what is not robust (`steady`) or unreached."""
        while (best := self.nearest()).distance == 0:
            first = self._first_fragile(best) or self._first_out_of_reach(best)
            if first is None:
                return True
            below = [node for node in self.nodes if first in node.path()]
            self.nodes = [node for node in self.nodes if node not in below]
            self._rule.drop(below)
        return False

    def _first_fragile(self, best: Node) -> Node | None:
        """With `steady`, the first node on the path that is not robust."""
        unproven = [node for node in best.path() if not node.steady]
        if not (self.config.steady and unproven):
            return None
        robust = are_robust(_steps_to(unproven), self.simulator.config)
        for node, node_is_robust in zip(unproven, robust, strict=True):
            node.steady = node_is_robust
        return None if all(robust) else unproven[robust.index(False)]

    def _first_out_of_reach(self, best: Node) -> Node | None:
        """The first node on the path that the arm does not get to, if any."""
        if self._reach is None or best.reached:
            return None
        first = self._reach.first_failed(self.plan(True, "", best))
        best.reached = first is None
        return None if first is None else best.path()[first]

    def reaches(self, node: Node) -> bool:
        """Whether the arm, if there is one, can follow the plan to a node."""
        if node.reached is None:
            self._first_out_of_reach(node)
        return node.reached is not False

    def nearest(self) -> Node:
        """The node at the goal or nearest to it; the one of the shortest path among equals."""
        return min(self.nodes, key=lambda node: (node.distance, len(node.path())))

    def plan(self, solved: bool, reason: str, node: Node | None = None) -> KnotPlan:
        """The plan that leads to a node, by default to the one nearest to the goal."""
        root, simulation = self.nodes[0], self.simulator.config
        return KnotPlan(
            goal=self.goal.name,
            goal_states=tuple(sorted(self.goal.states)),
            solved=solved,
            reason=reason if solved else f"{reason} without reaching the goal",
            start=root.points,
            start_state=root.state,
            steps=_steps_to((node or self.nearest()).path()),
            tried=tuple(ExpansionStats(*key, count) for key, count in self.tried.items()),
            branches=self.branches,
            kept=self.kept,
            seconds=self.elapsed(),
            radius=simulation.rope.radius,
        )


def _steps_to(nodes: Sequence[Node]) -> tuple[PlanStep, ...]:
    """The step by which each node was reached; the root has none."""
    return tuple(node.step for node in nodes if node.step is not None)


def _group_by_action(
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


def plan_knot(
    points: Floats,
    goal: Goal,
    sampler: Sampler,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: PlannerConfig | None = None,
    progress: Progress | None = None,
    observe: Observer | None = None,
    reach: Reach | None = None,
    earlier: KnotPlan | None = None,
) -> KnotPlan:
    """Plan how to tie a knot into a rope (V, 3), metres, at rest in any state (Sec. V-B d).

    The same rng gives the same plan for the same batch size, unless `max_seconds` ends it.
    `progress` is called after every batch, and `observe` with its attempts, one action and start
    state at a time. With `reach`, splines out of an arm's reach are not simulated, and a
    plan counts only if the arm can follow it all. With an `earlier` plan for this goal, such as the
    one whose first step led here, what is left of it is tried first.

    Raises:
        UnreachableGoalError: no actions lead from the rope's state to the goal.
        ShapeError: points that are not a shape of the simulator's rope.
        DegenerateCurveError: the projection of the rope does not determine its state.

    Warns:
        UnlikeRopeWarning: a trained sampler has learned with a rope of another size.
    """
    search = TreeSearch(points, goal, sampler, simulator, rng, config, observe, reach, earlier)
    return search.run(progress)
