"""From one image to shape, state and doubts."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.perception.camera.image import ImageError, RgbdImage
from knotflow.perception.estimation import estimate as estimation
from knotflow.perception.estimation.crossings import score_crossings
from knotflow.perception.estimation.estimate import EstimateConfig, estimate
from knotflow.perception.estimation.fitting import FitConfig
from knotflow.perception.estimation.search import SearchConfig, SearchResult
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.networks.network import Network, shipped_network
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, image, loop, s_curve, target

QUICK = EstimateConfig(
    FitConfig(steps=30), search=SearchConfig(guesses=1, rounds=0), fallback_search=None
)


@pytest.mark.slow
@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_shape_state_and_head_are_read_off_an_image(points):
    found = estimate(image(points, head=True), CAMERA, ROPE, config=QUICK)
    assert found.head_known
    assert np.linalg.norm(found.points - points, axis=1).mean() < 4e-3
    assert found.state == TopologicalState.from_curve(points)
    assert not found.ambiguous, found.ambiguities
    assert found.visible.mean() > 0.85


@pytest.mark.slow
def test_a_rope_whose_ends_look_alike_keeps_the_direction_it_had():
    points = s_curve()
    for last in (points, points[::-1]):
        guess = points + [0, 0.004, 0]
        found = estimate(image(points), CAMERA, ROPE, guess, QUICK, earlier=last)
        assert found.head_known
        assert np.linalg.norm(found.points - last, axis=1).mean() < 4e-3


@pytest.mark.slow
def test_a_guess_of_the_shape_still_has_its_head_looked_for():
    points = s_curve()
    found = estimate(image(points, head=True), CAMERA, ROPE, points[::-1], QUICK)
    assert found.head_known
    assert np.linalg.norm(found.points - points, axis=1).mean() < 4e-3
    assert not estimate(image(points), CAMERA, ROPE, points, QUICK).head_known


@pytest.mark.slow
def test_without_colour_and_past_the_head_is_unknown():
    assert not estimate(image(s_curve()), CAMERA, ROPE, config=QUICK).head_known


@pytest.mark.slow
def test_what_is_likely_must_account_for_the_image(monkeypatch):
    truth, config = loop(1), QUICK
    seen, asked = image(truth, head=True), []
    trace = estimation.trace
    monkeypatch.setattr(estimation, "trace", lambda *one: asked.append(one) or trace(*one))
    near, far = truth + [0.0, 0.005, 0.0], s_curve()
    found = estimate(seen, CAMERA, ROPE, config=config, likely=[far, near])
    assert asked == [] and np.linalg.norm(found.points - truth, axis=1).mean() < 4e-3
    found = estimate(seen, CAMERA, ROPE, config=config, likely=[far])
    assert asked and found.state == TopologicalState.from_curve(truth)


@pytest.mark.parametrize(("first", "efforts"), [("right", 1), ("wrong", 2)])
def test_it_is_searched_on_with_more_effort_while_what_was_found_is_in_doubt(
    monkeypatch, first, efforts
):
    truth, wrong = loop(1), s_curve()
    tried = []

    def search(guesses, near, eye, rope, effort, fine, before, progress):
        tried.append((effort, before))
        return SearchResult([wrong if first == "wrong" and len(tried) == 1 else truth], [])

    monkeypatch.setattr(estimation, "search", search)
    config = EstimateConfig(fallback_search=SearchConfig(paths=1, rounds=2))
    found = estimate(image(truth, head=True), CAMERA, ROPE, config=config)
    assert [effort for effort, _ in tried] == [config.search, config.fallback_search][:efforts]
    assert not found.ambiguous and found.state == TopologicalState.from_curve(truth)
    if efforts == 2:
        np.testing.assert_array_equal(tried[1][1].shapes, [wrong])  # it goes on from there


def test_a_rope_that_leaves_the_image_is_not_searched_on_for(monkeypatch):
    tried = []
    monkeypatch.setattr(
        estimation, "search", lambda *_: tried.append(1) or SearchResult([s_curve()], [])
    )
    gone = s_curve() + [0.75, 0, 0]
    assert estimate(image(gone), CAMERA, ROPE).ambiguous and len(tried) == 1


@pytest.mark.slow
@pytest.mark.parametrize(("credit", "kept"), [(2.0, True), (0.0, False), (2.0, False)])
def test_a_state_that_was_likely_gives_way_to_one_that_is_much_likelier(monkeypatch, credit, kept):
    # Whatever the image: what a search finds and how likely that is are given here.
    likely, other = loop(1), s_curve()
    lead = 1.0 if kept or credit == 0 else 3.0

    def losses(shapes, target, camera, rope, config):
        return np.array([0.0, lead]) / target.independent_pixels

    monkeypatch.setattr(estimation, "is_plausible", lambda *_: False)
    monkeypatch.setattr(estimation, "search", lambda *_: SearchResult([other, likely], []))
    monkeypatch.setattr(estimation, "total_loss", losses)
    config = replace(QUICK, prior_credit=credit, propose=False)
    found = estimate(image(likely), CAMERA, ROPE, config=config, likely=[likely])
    assert found.state == TopologicalState.from_curve(likely if kept else other)
    # Either way they are near each other: the other one is named as a doubt.
    assert any("another path" in doubt for doubt in found.ambiguities)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.8, 1.25])
def test_a_rope_thinner_or_thicker_than_it_is_said_to_be_is_no_doubt(monkeypatch, share):
    points = s_curve()
    monkeypatch.setattr(estimation, "search", None)  # the likely shape does
    seen = image(points, radius=share * ROPE.radius)
    found = estimate(seen, CAMERA, ROPE, config=QUICK, likely=[points + [0, 0.004, 0]])
    assert not found.ambiguities and found.coverage_fraction > 0.99
    assert np.linalg.norm(found.points - points, axis=1).mean() < 4e-3
    nominal = estimate(image(points), CAMERA, ROPE, points, QUICK).seen_radius
    assert found.seen_radius == pytest.approx(share * nominal, rel=0.06)


def test_nothing_likely_is_seen_on_a_bare_table():
    bare = image(s_curve())
    table = RgbdImage(np.full_like(bare.rgb, 60), np.full_like(bare.depth, CAMERA.position[2]))
    with pytest.raises(TraceError):
        estimate(table, CAMERA, ROPE, config=QUICK, likely=[s_curve()])


@pytest.mark.slow
def test_a_crossing_the_wrong_way_round_is_turned():
    truth, wrong = loop(1), loop(-1)
    wrong[:, :2] = truth[:, :2]
    shape, (crossing,) = score_crossings(wrong, target(truth), CAMERA, ROPE)
    assert not crossing.first_over and crossing.certainty > 0.95
    assert crossing.gap > ROPE.radius
    assert TopologicalState.from_curve(shape) == TopologicalState.from_curve(truth)


@pytest.mark.slow
def test_a_crossing_that_the_image_does_not_tell_is_in_doubt():
    points = loop(1)
    blind = replace(target(points), depth=target(points).depth * np.nan)
    _, (crossing,) = score_crossings(points, blind, CAMERA, ROPE)
    assert crossing.certainty < 0.95


def test_a_shape_that_does_not_account_for_the_image_is_in_doubt():
    away = s_curve() + [0, 0.3, 0]
    found = estimate(image(s_curve()), CAMERA, ROPE, initial=away, config=QUICK)
    assert found.ambiguous and found.coverage_fraction < 0.5


def test_a_rope_that_leaves_the_image_is_in_doubt_and_its_state_unknown():
    points = s_curve() + [0.75, 0, 0]
    found = estimate(image(points), CAMERA, ROPE, initial=points, config=QUICK)
    assert "the rope leaves the image" in found.ambiguities and found.state is None
    assert not found.visible[-5:].any() and found.visible[:20].all()


@pytest.mark.slow
def test_most_of_a_rope_outside_of_the_image_is_followed_as_far_as_it_is_seen():
    points = s_curve() + [1.1, 0, 0]
    found = estimate(image(points), CAMERA, ROPE, config=QUICK)
    assert "the rope leaves the image" in found.ambiguities and found.state is None
    assert np.isfinite(found.points).all() and found.visible.any() and not found.visible.all()


def test_a_rope_whose_depth_is_lost_is_not_made_up():
    seen = image(s_curve())
    lost = np.where(seen.rgb[..., 0] > 100, np.float32(np.nan), seen.depth)
    with pytest.raises(TraceError):
        estimate(RgbdImage(seen.rgb, lost), CAMERA, ROPE)


def test_an_image_without_rope_holds_none():
    bare = image(s_curve())
    depth = np.full_like(bare.depth, CAMERA.position[2])
    with pytest.raises(TraceError):
        estimate(RgbdImage(np.full_like(bare.rgb, 60), depth), CAMERA, ROPE)


@pytest.mark.slow
def test_the_shipped_network_proposes_unless_it_shall_not(monkeypatch):
    asked = []

    def propose(network, *_):
        asked.append(network)
        return [s_curve()]

    monkeypatch.setattr(Network, "guesses", propose)
    given = Network(shipped_network().model)
    for network, config in ((None, QUICK), (given, QUICK), (None, replace(QUICK, propose=False))):
        estimate(image(s_curve()), CAMERA, ROPE, config=config, network=network)
    assert asked == [shipped_network(), given]


def test_an_image_of_another_size_is_refused():
    small = image(s_curve())
    with pytest.raises(ImageError, match="the camera's are"):
        estimate(RgbdImage(small.rgb[::2], small.depth[::2]), CAMERA, ROPE)
