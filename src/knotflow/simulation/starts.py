"""Start shapes: generated ones without crossings, and others reached by executing actions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from knotflow.simulation.attempt import Observer, attempt
from knotflow.simulation.rope import RopeConfig
from knotflow.simulation.simulator import RopeSimulator
from knotflow.simulation.spline import SPLINE_HIGH, SPLINE_LOW
from knotflow.topology import Action, TopologicalState, segment_lengths
from knotflow.topology.curve import as_rope
from knotflow.topology.polyline import Floats, arc_lengths, interpolate

Propose = Callable[[Floats, Action, int, np.random.Generator], Floats]
"""`Sampler.sample`."""

MEMORY = 0.31
"""Share of the rope's length over which a random curve's heading forgets a wiggle."""


@dataclass
class StartsConfig:
    """Parameters of start shapes."""

    bend: float = 2.5
    """Standard deviation of a random curve's mean curvature, radians a rope's length."""
    most_bend: float = 4.4
    """Its largest value, radians a rope's length."""
    wiggle: float = 0.3
    """Standard deviation of the heading around that arc, radians."""
    shift: float = 0.1
    """Largest distance of a random curve's middle from the origin in x and y, metres."""
    shortest_segment: float = 0.01
    """Least length of a segment of a start reached by actions, metres."""
    rounds: int = 6
    """Splines tried on a start before it is replaced by another."""

    def __post_init__(self) -> None:
        for name in ("bend", "most_bend", "wiggle", "shift", "shortest_segment"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"starts.{name} must be 0 or more, got {getattr(self, name)}")
        if not 1 <= self.rounds <= 1000:
            raise ValueError(f"starts.rounds must be 1 to 1000, got {self.rounds}")


def straight(rope: RopeConfig) -> Floats:
    """A straight rope (V, 3) along x, its middle at the origin, metres."""
    return _from_headings(np.zeros(rope.links), rope)


def arc(rope: RopeConfig, angle: float = np.pi) -> Floats:
    """A rope (V, 3) along a circular arc that turns left by `angle` radians, metres."""
    return _from_headings(np.linspace(-angle / 2, angle / 2, rope.links), rope)


def random_curve(
    rope: RopeConfig, rng: np.random.Generator, config: StartsConfig | None = None
) -> Floats:
    """A random rope (V, 3) without crossings, metres, near the origin.

    The heading is an arc's plus an Ornstein-Uhlenbeck walk that forgets in `MEMORY`. Vertices of
    strands are kept apart; of very curved ropes (`config.bend` 4) one in 500 crosses itself.
    """
    config = config or StartsConfig()
    along = (np.arange(rope.links) + 0.5) / rope.links
    keep = np.exp(-1 / (MEMORY * rope.links))
    for _ in range(10_000):
        bend = rng.normal(0, config.bend)
        steps = rng.normal(0, config.wiggle * np.sqrt(1 - keep**2), rope.links)
        shift, heading = rng.uniform(-config.shift, config.shift, 2), rng.uniform(-np.pi, np.pi)
        if abs(bend) > config.most_bend:
            continue
        for i in range(1, rope.links):
            steps[i] += keep * steps[i - 1]
        points = _from_headings(heading + bend * along + steps, rope)
        points[:, :2] += shift
        if _strand_distance(points, rope) >= 2 * rope.radius:
            return points
    raise RuntimeError(
        "no random curve without crossings was found in 10000 draws; lower starts.bend"
    )


def random_trials(
    rope: RopeConfig, count: int, rng: np.random.Generator, config: StartsConfig | None = None
) -> tuple[Floats, Floats]:
    """Random curves (count, V, 3), metres, and a random spline (count, 6) for each."""
    points = np.stack([random_curve(rope, rng, config) for _ in range(count)])
    return points, rng.uniform(SPLINE_LOW, SPLINE_HIGH, (count, 6))


def reach_starts(
    actions: Sequence[Action],
    count: int,
    simulator: RopeSimulator,
    propose: Propose,
    rng: np.random.Generator,
    config: StartsConfig | None = None,
    observe: Observer | None = None,
) -> Starts:
    """Starts reached by executing `actions` from the trivial state, each from its own random curve.

    Raises:
        RuntimeError: hardly any proposed spline reaches the state.
    """
    config = config or StartsConfig()
    if not actions:
        curves = [random_curve(simulator.config.rope, rng, config) for _ in range(count)]
        return Starts(np.stack(curves), reached=count, too_tight=0)
    state = TopologicalState.trivial()
    for action in actions[:-1]:
        state = state.apply(action)
    found: list[Floats] = []
    hits = tight = drawn = 0
    while len(found) < count:
        missing = max(8, int(1.5 * (count - len(found))))
        if drawn > 40 * count + 60:
            raise RuntimeError(
                f"only {len(found)} of {count} starts for {actions[-1]} were reached from {drawn} "
                "ropes; the proposals hardly ever succeed"
            )
        previous = reach_starts(actions[:-1], missing, simulator, propose, rng, config, observe)
        parents = previous.points
        drawn += missing
        open_ = np.arange(missing)
        for _ in range(config.rounds):
            splines = np.concatenate([propose(parents[i], actions[-1], 1, rng) for i in open_])
            tried = attempt(simulator, parents[open_], splines, actions[-1], state, observe)
            ends, hit = tried.rollouts.end_points, tried.success
            rope = simulator.config.rope
            roomy = np.array(
                [ok and is_roomy(end, rope, config) for ok, end in zip(hit, ends, strict=True)]
            )
            hits, tight = hits + hit.sum(), tight + (hit & ~roomy).sum()
            found.extend(ends[roomy])
            open_ = open_[~roomy]
            if len(open_) == 0:
                break
    return Starts(np.stack(found[:count]), reached=int(hits), too_tight=int(tight))


def random_tangle(
    accept: Callable[[TopologicalState], bool],
    simulator: RopeSimulator,
    propose: Propose,
    rng: np.random.Generator,
    config: StartsConfig | None = None,
    most_crossings: int = 3,
) -> Floats:
    """A rope (V, 3), metres, tangled by executing random legal actions until its state is accepted.

    A rope with more than `most_crossings` is given up for another.

    Raises:
        RuntimeError: no such rope came up.
    """
    rope, config = simulator.config.rope, config or StartsConfig()
    points, state = random_curve(rope, rng, config), TopologicalState.trivial()
    for _ in range(2000):
        actions = [action for action, _ in state.actions()]
        action = actions[rng.integers(len(actions))]
        spline = propose(points, action, 1, rng)
        tried = attempt(simulator, points, spline, action, state)
        (end,) = tried.ends
        if end is None or end.num_crossings > most_crossings:
            points, state = random_curve(rope, rng, config), TopologicalState.trivial()
            continue
        points, state = np.asarray(tried.rollouts.end_points[0]), end
        if state.num_crossings and accept(state):
            return points
    raise RuntimeError("no tangled rope was accepted in 2000 attempts; accept more states")


@dataclass(frozen=True)
class Starts:
    """Start shapes, and how many of those reached were rejected as too tight."""

    points: Floats  # (N, V, 3) rope vertices, metres
    reached: int  # ropes in the state, the tight ones included
    too_tight: int  # of these, ropes with a segment shorter than `StartsConfig.shortest_segment`


def resample(points: ArrayLike, rope: RopeConfig) -> Floats:
    """A curve (N, 3), metres, as vertices (V, 3) of equal links of this rope; the first stays."""
    points = as_rope(points)
    # Equal chords, not equal arcs, give every link its length.
    for _ in range(50):
        along = arc_lengths(points)
        if along[-1] == 0:
            raise ValueError("a curve needs a length, but all its points are the same")
        at = np.linspace(0, along[-1], rope.num_vertices)
        points = interpolate(at, along, points)
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if np.ptp(chords) < 1e-6 * chords.mean():
            break
    direction = np.diff(points, axis=0)
    direction *= rope.link_length / np.linalg.norm(direction, axis=1, keepdims=True)
    result: Floats = points[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(direction, axis=0)])
    return result


def _from_headings(heading: Floats, rope: RopeConfig) -> Floats:
    """A resting rope whose links have the given headings (links,), its middle at the origin."""
    steps = rope.link_length * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    points = np.full((rope.num_vertices, 3), rope.radius)
    points[:, :2] = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    points[:, :2] -= points[:, :2].mean(axis=0)
    return points


def _strand_distance(points: Floats, rope: RopeConfig) -> float:
    """Least distance between vertices that are apart along the rope by more than a turn; infinite
    where none are."""
    apart = int(np.ceil(4 * np.pi * rope.radius / rope.link_length))
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return float(distance[np.triu_indices(len(points), apart)].min(initial=np.inf))


def is_roomy(points: Floats, rope: RopeConfig, config: StartsConfig) -> bool:
    """Whether every segment of a rope (V, 3) is long enough to work with."""
    return bool((segment_lengths(points) * rope.length >= config.shortest_segment).all())
