"""One contract over every start generator, and starts made by executing actions."""

from itertools import cycle

import numpy as np
import pytest

from knotflow.samplers.demonstrations import heuristic_splines
from knotflow.simulation import (
    RopeConfig,
    StartsConfig,
    arc,
    attempt,
    check_points,
    random_curve,
    random_tangle,
    reach_starts,
    resample,
    straight,
)
from knotflow.topology import (
    IllegalActionError,
    TopologicalState,
    parse_action,
    segment_lengths,
)

ROPES = [RopeConfig(), RopeConfig(links=25, length=0.7, radius=0.005)]


@pytest.mark.parametrize("rope", ROPES)
@pytest.mark.parametrize(
    "make", [straight, arc, lambda rope: random_curve(rope, np.random.default_rng(3))]
)
def test_untangled_starts_lie_on_the_table(rope, make):
    points = make(rope)
    check_points(points, rope)
    np.testing.assert_allclose(points[:, 2], rope.radius)
    assert np.abs(points[:, :2].mean(axis=0)).max() <= StartsConfig().shift
    assert TopologicalState.from_curve(points) == TopologicalState.trivial()


def test_arc_turns_left_by_its_angle():
    rope = RopeConfig()
    heading = np.diff(arc(rope, np.pi), axis=0)
    angle = np.unwrap(np.arctan2(heading[:, 1], heading[:, 0]))
    assert angle[-1] - angle[0] == pytest.approx(np.pi)


def test_random_curves_are_wiggling_arcs_of_all_directions(rng):
    rope, config = RopeConfig(), StartsConfig()
    curves = np.stack([random_curve(rope, rng, config) for _ in range(200)])
    links = np.diff(curves[..., :2], axis=1)
    heading = np.unwrap(np.arctan2(links[..., 1], links[..., 0]), axis=1)
    slope, _ = np.polyfit(np.linspace(0, 1, 40), (heading - heading[:, :1]).T, 1)
    assert 1.8 < slope.std() < 3.0
    assert np.abs(slope).max() < config.most_bend + 5 * config.wiggle
    assert abs(np.exp(1j * heading[:, 20]).mean()) < 0.2


def test_strands_of_random_curves_do_not_touch(rng):
    rope = RopeConfig(radius=0.02, links=50)
    curves = [random_curve(rope, rng, StartsConfig(bend=5.0, most_bend=8.0)) for _ in range(40)]
    apart = np.arange(rope.num_vertices)[:, None] - np.arange(rope.num_vertices)
    far = apart * rope.link_length >= 4 * np.pi * rope.radius
    for points in curves:
        assert TopologicalState.from_curve(points) == TopologicalState.trivial()
        between = np.linalg.norm(points[:, None] - points, axis=-1)
        assert between[far].min() >= 2 * rope.radius


def test_a_rope_too_short_to_touch_itself_has_curves(rng):
    rope = RopeConfig(radius=0.1, links=10)
    assert random_curve(rope, rng).shape == (11, 3)


def test_equal_seeds_give_equal_starts():
    rope = RopeConfig()
    one, other = (random_curve(rope, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(one, other)


@pytest.mark.slow
def test_reached_starts_have_the_state(simulator, rng):
    actions = [parse_action("R1(0,1,1)"), parse_action("C(0,1,1)")]
    goal = TopologicalState.trivial().apply(actions[0]).apply(actions[1])
    seen = []
    starts = reach_starts(actions, 3, simulator, heuristic_splines, rng, observe=seen.append)
    assert starts.points.shape == (3, 41, 3)
    for points in starts.points:
        check_points(points, simulator.config.rope)
        assert TopologicalState.from_curve(points) == goal
    hits = sum(batch.success.sum() for batch in seen if batch.action == actions[1])
    assert hits == starts.reached >= 3
    assert len({points.tobytes() for points in starts.points}) == 3


def test_reached_starts_are_roomy(world, long_headed_shape_of, rng):
    action = parse_action("R1(0,1,1)")
    loop = TopologicalState.trivial().apply(action)
    roomy, tight = (long_headed_shape_of(loop, share) for share in (0.0, 0.8))
    lengths = [segment_lengths(points).min() for points in (roomy, tight)]
    config = StartsConfig(shortest_segment=float(np.mean(lengths)))
    proposed, ends = world(), cycle([tight, roomy])

    def propose(points, action, count, rng):
        splines = proposed.sample(points, action, count, rng)
        proposed.ends |= {spline.tobytes(): next(ends) for spline in splines}
        return splines

    starts = reach_starts([action], 5, proposed, propose, rng, config)
    assert (starts.points == roomy).all()
    assert (starts.reached, starts.too_tight) == (16, 8)


@pytest.mark.slow
def test_failing_proposals_raise(simulator, rng):
    def stay(points, action, count, rng):
        middle = points[20]
        return np.tile([0.5, *middle[:2], 0.02, *middle[:2]], (count, 1))

    with pytest.raises(RuntimeError, match="hardly ever succeed"):
        reach_starts([parse_action("R1(0,1,1)")], 1, simulator, stay, rng, StartsConfig(rounds=1))


@pytest.mark.slow
def test_attempts_read_the_state_at_rest(simulator, rng):
    action = parse_action("R1(0,1,1)")
    points = straight(simulator.config.rope)
    tried = attempt(
        simulator,
        points,
        heuristic_splines(points, action, 64, rng),
        action,
        TopologicalState.trivial(),
    )
    assert 0 < tried.success.sum() < 64
    for hit, end, state in zip(tried.success, tried.rollouts.end_points, tried.ends, strict=True):
        if state is not None:
            assert TopologicalState.from_curve(end) == state
        assert hit == (state == tried.goal)


def test_illegal_action_is_rejected_before_simulation(simulator):
    points = straight(simulator.config.rope)
    with pytest.raises(IllegalActionError):
        attempt(
            simulator,
            points,
            np.zeros((1, 6)),
            parse_action("C(0,2,1)"),
            TopologicalState.trivial(),
        )


@pytest.mark.parametrize("vertices", [2, 7, 300])
def test_resampling_gives_equal_links(vertices):
    rope = RopeConfig()
    along = np.linspace(0, 1.2, vertices)
    curve = np.stack([along, 0.1 * np.sin(3 * along), np.full(vertices, 0.008)], axis=1)
    points = resample(curve, rope)
    check_points(points, rope)
    np.testing.assert_allclose(points[0], curve[0])


def test_resampling_is_idempotent():
    points = arc(RopeConfig())
    np.testing.assert_allclose(resample(points, RopeConfig()), points, atol=1e-9)


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        (np.zeros((5, 2)), r"\(V, 3\)"),
        (np.zeros((1, 3)), r"V >= 2"),
        (np.zeros((5, 3)), "all its points are the same"),
        (np.array([[0, 0, 0], [np.nan, 0, 0], [1, 0, 0]]), "vertex 1 is not finite"),
    ],
)
def test_invalid_curves_are_rejected(curve, message):
    with pytest.raises(ValueError, match=message):
        resample(curve, RopeConfig())


def test_random_tangle_is_accepted_and_never_beyond_its_crossings(world):
    seen = []

    def accept(state):
        seen.append(state.num_crossings)
        return state.num_crossings == 2 and seen.count(2) == 2

    sampler, rng = world(chance=0.7), np.random.default_rng(3)
    points = random_tangle(accept, sampler, sampler.sample, rng, most_crossings=2)
    assert TopologicalState.from_curve(points).num_crossings == 2 and seen.count(2) == 2
    assert {*seen} == {1, 2}


def test_random_tangle_has_accepted_state_and_is_repeatable(simulator):
    wanted = TopologicalState.parse("1o4+2o3-")

    def outside(state):
        return state.num_crossings == 2 and state != wanted

    rng = np.random.default_rng(2)
    points = random_tangle(outside, simulator, heuristic_splines, rng, most_crossings=2)
    assert outside(TopologicalState.from_curve(points))
    again = random_tangle(
        outside, simulator, heuristic_splines, np.random.default_rng(2), most_crossings=2
    )
    np.testing.assert_array_equal(points, again)
