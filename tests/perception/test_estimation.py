"""From one image to shape, state and ambiguities."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.perception.camera.image import ImageError, RgbdImage
from knotflow.perception.estimation import estimate as estimation
from knotflow.perception.estimation.crossings import CrossingEvidence, score_crossings
from knotflow.perception.estimation.estimate import EstimateConfig, estimate, list_ambiguities
from knotflow.perception.estimation.fitting import FitConfig
from knotflow.perception.estimation.search import SearchConfig, SearchResult
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.networks.network import StrandNetwork, shipped_network
from knotflow.simulation import state_or_none
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, image, loop, s_curve, target

QUICK = EstimateConfig(
    FitConfig(steps=30),
    search=SearchConfig(guesses=1, rounds=0),
    fallback_search=None,
    colour=False,
)


@pytest.mark.slow
@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_estimate_shape_state_and_head(points):
    found = estimate(image(points, head=True), CAMERA, ROPE, config=QUICK)
    assert found.head_known
    assert np.linalg.norm(found.points - points, axis=1).mean() < 4e-3
    assert found.state == TopologicalState.from_curve(points)
    assert not found.ambiguous, found.ambiguities
    assert found.visible.mean() > 0.85


@pytest.mark.slow
def test_earlier_shape_determines_head():
    points = s_curve()
    for last in (points, points[::-1]):
        guess = points + [0, 0.004, 0]
        found = estimate(image(points), CAMERA, ROPE, guess, QUICK, earlier=last)
        assert found.head_known
        assert np.linalg.norm(found.points - last, axis=1).mean() < 4e-3


@pytest.mark.slow
def test_initial_guess_does_not_determine_head():
    points = s_curve()
    found = estimate(image(points, head=True), CAMERA, ROPE, points[::-1], QUICK)
    assert found.head_known
    assert np.linalg.norm(found.points - points, axis=1).mean() < 4e-3
    assert not estimate(image(points), CAMERA, ROPE, points, QUICK).head_known


@pytest.mark.slow
def test_head_unknown_without_colour_or_earlier_shape():
    assert not estimate(image(s_curve()), CAMERA, ROPE, config=QUICK).head_known


@pytest.mark.slow
def test_likely_shape_must_explain_image(monkeypatch):
    truth, config = loop(1), QUICK
    seen, asked = image(truth, head=True), []
    trace = estimation.trace
    monkeypatch.setattr(estimation, "trace", lambda *one: asked.append(one) or trace(*one))
    near, far = truth + [0.0, 0.005, 0.0], s_curve()
    found = estimate(seen, CAMERA, ROPE, config=config, likely=[far, near])
    assert asked == [] and np.linalg.norm(found.points - truth, axis=1).mean() < 4e-3
    found = estimate(seen, CAMERA, ROPE, config=config, likely=[far])
    assert asked and found.state == TopologicalState.from_curve(truth)


@pytest.mark.slow
@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_a_rope_that_colour_shows_is_not_searched_for(monkeypatch, points):
    searched = []
    trace = estimation.trace
    monkeypatch.setattr(estimation, "trace", lambda *one: searched.append(one) or trace(*one))
    config = replace(QUICK, colour=True)
    found = estimate(image(points, head=True), CAMERA, ROPE, config=config)
    # In a flat silhouette, which strand is on top is a guess.
    assert not searched or state_or_none(points).num_crossings
    assert np.linalg.norm(found.points - points, axis=1).mean() < 4e-3
    assert found.state == TopologicalState.from_curve(points) and not found.ambiguous


@pytest.mark.slow
@pytest.mark.parametrize(("first", "efforts"), [("right", 1), ("wrong", 2)])
def test_fallback_search_runs_while_ambiguous(monkeypatch, first, efforts):
    truth, wrong = loop(1), s_curve()
    tried = []

    def search(guesses, near, effort, fine, before, progress):
        tried.append((effort, before))
        return SearchResult([wrong if first == "wrong" and len(tried) == 1 else truth], [])

    monkeypatch.setattr(estimation, "search", search)
    config = EstimateConfig(fallback_search=SearchConfig(paths=1, rounds=2), colour=False)
    found = estimate(image(truth, head=True), CAMERA, ROPE, config=config)
    assert [effort for effort, _ in tried] == [config.search, config.fallback_search][:efforts]
    assert not found.ambiguous and found.state == TopologicalState.from_curve(truth)
    if efforts == 2:
        np.testing.assert_array_equal(tried[1][1].shapes, [wrong])  # it goes on from there


@pytest.mark.slow
def test_no_fallback_search_if_rope_leaves_image(monkeypatch):
    tried = []
    monkeypatch.setattr(
        estimation, "search", lambda *_: tried.append(1) or SearchResult([s_curve()], [])
    )
    gone = s_curve() + [0.75, 0, 0]
    config = EstimateConfig(colour=False)
    assert estimate(image(gone), CAMERA, ROPE, config=config).ambiguous and len(tried) == 1


@pytest.mark.slow
@pytest.mark.parametrize(("credit", "kept"), [(2.0, True), (0.0, False), (2.0, False)])
def test_expected_state_yields_to_much_likelier_state(monkeypatch, credit, kept):
    # Whatever the image: what a search finds and how likely that is are given here.
    likely, other = loop(1), s_curve()
    lead = 1.0 if kept or credit == 0 else 3.0

    def losses(shapes, target, config):
        return np.array([0.0, lead]) / target.independent_pixels

    monkeypatch.setattr(estimation, "is_plausible", lambda *_: False)
    monkeypatch.setattr(estimation, "search", lambda *_: SearchResult([other, likely], []))
    monkeypatch.setattr(estimation, "total_loss", losses)
    config = replace(QUICK, prior_credit=credit)
    found = estimate(image(likely), CAMERA, ROPE, config=config, likely=[likely])
    assert found.state == TopologicalState.from_curve(likely if kept else other)
    # Either way they are near each other: the other one is named as a doubt.
    assert any("another path" in doubt for doubt in found.ambiguities)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.8, 1.25])
def test_wrong_rope_radius_is_not_ambiguous(monkeypatch, share):
    points = s_curve()
    monkeypatch.setattr(estimation, "search", None)  # the likely shape does
    seen = image(points, radius=share * ROPE.radius)
    found = estimate(seen, CAMERA, ROPE, config=QUICK, likely=[points + [0, 0.004, 0]])
    assert not found.ambiguities and found.coverage_fraction > 0.99
    assert np.linalg.norm(found.points - points, axis=1).mean() < 4e-3
    nominal = estimate(image(points), CAMERA, ROPE, points, QUICK).seen_radius
    assert found.seen_radius == pytest.approx(share * nominal, rel=0.06)


def test_likely_shape_on_bare_table_raises():
    bare = image(s_curve())
    table = RgbdImage(np.full_like(bare.rgb, 60), np.full_like(bare.depth, CAMERA.position[2]))
    with pytest.raises(TraceError):
        estimate(table, CAMERA, ROPE, config=QUICK, likely=[s_curve()])


@pytest.mark.slow
def test_wrong_crossing_is_corrected():
    truth, wrong = loop(1), loop(-1)
    wrong[:, :2] = truth[:, :2]
    shape, (crossing,) = score_crossings(wrong, target(truth))
    assert not crossing.first_over and crossing.certainty > 0.95
    assert crossing.gap > ROPE.radius
    assert TopologicalState.from_curve(shape) == TopologicalState.from_curve(truth)


@pytest.mark.slow
def test_undetermined_crossing_is_ambiguous():
    points = loop(1)
    blind = replace(target(points), depth=target(points).depth * np.nan)
    _, (crossing,) = score_crossings(points, blind)
    assert crossing.certainty < 0.95


@pytest.mark.slow
def test_low_coverage_is_ambiguous():
    away = s_curve() + [0, 0.3, 0]
    found = estimate(image(s_curve()), CAMERA, ROPE, initial=away, config=QUICK)
    assert found.ambiguous and found.coverage_fraction < 0.5


def test_rope_leaving_image_has_no_state():
    points = s_curve() + [0.75, 0, 0]
    found = estimate(image(points), CAMERA, ROPE, initial=points, config=QUICK)
    assert "the rope leaves the image" in found.ambiguities and found.state is None
    assert not found.visible[-5:].any() and found.visible[:20].all()


@pytest.mark.slow
def test_rope_mostly_outside_image():
    points = s_curve() + [1.1, 0, 0]
    found = estimate(image(points), CAMERA, ROPE, config=QUICK)
    assert "the rope leaves the image" in found.ambiguities and found.state is None
    assert np.isfinite(found.points).all() and found.visible.any() and not found.visible.all()


def test_rope_without_depth():
    seen = image(s_curve())
    lost = np.where(seen.rgb[..., 0] > 100, np.float32(np.nan), seen.depth)
    with pytest.raises(TraceError):
        estimate(RgbdImage(seen.rgb, lost), CAMERA, ROPE)


def test_image_without_rope_raises():
    bare = image(s_curve())
    depth = np.full_like(bare.depth, CAMERA.position[2])
    with pytest.raises(TraceError):
        estimate(RgbdImage(np.full_like(bare.rgb, 60), depth), CAMERA, ROPE)


def test_rope_without_a_path_is_none(monkeypatch):
    monkeypatch.setattr(estimation, "trace", lambda *_: [np.array([[120.0, 160.0]])])
    monkeypatch.setattr(estimation, "trace_rope", lambda *_: [])
    with pytest.raises(TraceError, match="no path"):
        estimate(image(s_curve()), CAMERA, ROPE, config=QUICK)


def test_network_is_not_asked_where_nothing_is_proposed(monkeypatch):
    monkeypatch.setattr(estimation, "trace_rope", lambda *_: pytest.fail("asked"))
    found = estimate(image(s_curve()), CAMERA, ROPE, config=replace(QUICK, proposals=0))
    assert found.state == TopologicalState.trivial()


@pytest.mark.slow
def test_shipped_network_is_default(monkeypatch):
    asked = []

    def trace_rope(network, _):
        asked.append(network)
        return [s_curve()]

    monkeypatch.setattr(estimation, "trace_rope", trace_rope)
    given = StrandNetwork()
    for network in (None, given):
        estimate(image(s_curve()), CAMERA, ROPE, config=QUICK, network=network)
    assert asked == [shipped_network(), given]


def test_image_of_wrong_size_raises():
    small = image(s_curve())
    with pytest.raises(ImageError, match="the camera's are"):
        estimate(RgbdImage(small.rgb[::2], small.depth[::2]), CAMERA, ROPE)


def test_list_ambiguities():
    seen, state = target(s_curve()), TopologicalState.trivial()
    sure, unsure = (CrossingEvidence((0.2, 0.7), True, 0.016, share) for share in (0.99, 0.7))
    assert list_ambiguities(state, (sure,), 1.0, seen) == []
    assert list_ambiguities(state, (sure, unsure), 0.5, seen) == [
        "the shape accounts for 50% of the rope in the image",
        "crossing 2 is this way round with 70% certainty",
    ]
    (unread,) = list_ambiguities(None, (), 1.0, seen)
    assert unread == "the shape's projection does not determine its state"
    gone = target(s_curve() + [0.75, 0, 0])
    assert gone.leaves_image and not seen.leaves_image
    assert list_ambiguities(None, (), 1.0, gone) == ["the rope leaves the image"]
