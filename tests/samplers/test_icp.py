"""ICP: alignment, weights, and Gaussians that move along."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.samplers import IcpConfig, IcpSampler
from knotflow.samplers.icp import AUTHORS_STD, align
from knotflow.samplers.sampler import has_capability
from knotflow.simulation import RopeConfig, Trials, random_curve
from knotflow.topology import TopologicalState, parse_action

TRIVIAL = TopologicalState.trivial()
R1 = parse_action("R1(0,1,1)")
ROPE = RopeConfig()


def motion(angle, x, y):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]])


def moved(points, by):
    result = points.copy()
    result[:, :2] = points[:, :2] @ by[:2, :2].T + by[:2, 2]
    return result


def trials(shapes, means, scale=0.003, count=40):
    rng = np.random.default_rng(0)
    noise = rng.normal(0, scale, (len(shapes), count, 6))
    return {
        R1: [
            Trials(R1, TRIVIAL, np.stack([shape] * count), mean + own, np.ones(count, bool))
            for shape, mean, own in zip(shapes, means, noise, strict=True)
        ]
    }


@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi, -2.5])
def test_alignment_finds_a_rigid_motion(rng, angle):
    points = random_curve(ROPE, rng)
    by = motion(angle, 0.1, -0.2)
    found, distance = align(points, moved(points, by))
    np.testing.assert_allclose(found, by, atol=1e-6)
    assert distance == pytest.approx(0, abs=1e-6)


def test_alignment_never_leaves_the_table(rng):
    """A mirror image is not a rigid motion on the table, though it is one in space."""
    points = random_curve(ROPE, rng)
    found, distance = align(points, points * [1, -1, 1])
    np.testing.assert_allclose(found[:2, :2] @ found[:2, :2].T, np.eye(2), atol=1e-6)
    assert np.linalg.det(found[:2, :2]) == pytest.approx(1)
    assert distance > 0.005


def test_no_other_motion_brings_the_vertices_closer(rng):
    source, target = random_curve(ROPE, rng), random_curve(ROPE, rng)

    def squares(by):
        apart = moved(source, by)[:, :2] - target[:, :2]
        return 64 * (apart**2).sum(axis=1).mean()

    by, distance = align(source, target)
    assert squares(by) == pytest.approx(distance)
    for angle, x, y in rng.normal(0, 0.02, (20, 3)):
        assert squares(motion(angle, x, y) @ by) > distance


def test_a_moved_rope_gets_the_moved_splines(rng):
    shape = random_curve(ROPE, rng)
    mean = np.array([0.8, 0.1, 0.05, 0.15, -0.1, 0.0])
    sampler = IcpSampler(trials([shape], [mean]), IcpConfig())
    by = motion(0.7, 0.05, -0.04)
    splines = sampler.sample(moved(shape, by), R1, 500, rng)
    np.testing.assert_allclose(splines[:, 0].mean(), 0.8, atol=0.001)
    np.testing.assert_allclose(splines[:, 3].mean(), 0.15, atol=0.001)
    for columns in ([1, 2], [4, 5]):
        expected = by[:2, :2] @ mean[columns] + by[:2, 2]
        np.testing.assert_allclose(splines[:, columns].mean(axis=0), expected, atol=0.002)


def test_the_nearest_demonstration_weighs_most(rng):
    shapes = [random_curve(ROPE, rng) for _ in range(4)]
    means = np.array([[0.1 + 0.2 * i, 0, 0, 0.1, 0, 0] for i in range(4)])
    sampler = IcpSampler(trials(shapes, means), IcpConfig(scale=1e-4))
    for shape, mean in zip(shapes, means, strict=True):
        assert sampler.sample(shape, R1, 50, rng)[:, 0].mean() == pytest.approx(mean[0], abs=0.01)
    even = IcpSampler(trials(shapes, means), IcpConfig(scale=1e4))
    assert even.sample(shapes[0], R1, 50, rng)[:, 0].mean() == pytest.approx(0.4, abs=0.01)


def test_only_successes_count(rng):
    shape = random_curve(ROPE, rng)
    good, bad = np.full((20, 6), 0.1), np.full((20, 6), 0.3)
    mixed = Trials(
        R1,
        TRIVIAL,
        np.stack([shape] * 40),
        np.concatenate([good, bad]),
        np.repeat([True, False], 20),
    )
    sampler = IcpSampler({R1: [mixed]}, IcpConfig())
    np.testing.assert_allclose(sampler.sample(shape, R1, 10, rng), 0.1, atol=1e-3)


def test_as_coded_demonstrated_splines_are_interpolated_with_fixed_noise(rng):
    shape, by = random_curve(ROPE, rng), motion(0.7, 0.05, -0.04)
    mean = np.array([0.5, 0.1, 0.05, 0.12, -0.1, 0.0])
    (shown,) = trials([shape], [mean], scale=0.02, count=400)[R1]
    failed = replace(shown, success=shown.splines[:, 0] > 0.52)
    sampler = IcpSampler({R1: [failed]}, IcpConfig(authors=True))
    splines = sampler.sample(moved(shape, by), R1, 4000, rng)
    assert splines[:, 0].mean() == pytest.approx(0.5, abs=0.003)
    np.testing.assert_allclose(
        splines[:, 1:3].mean(axis=0), by[:2, :2] @ mean[1:3] + by[:2, 2], atol=0.006
    )
    np.testing.assert_allclose(
        splines[:, [0, 1, 2, 4, 5]].std(axis=0), AUTHORS_STD[[0, 1, 2, 4, 5]], rtol=0.06
    )


def test_an_action_without_demonstration_is_refused(rng):
    sampler = IcpSampler(trials([random_curve(ROPE, rng)], [np.full(6, 0.1)]), IcpConfig())
    with pytest.raises(ValueError, match=r"no demonstration of C\(0,1,1\).*R1\(0,1,1\)"):
        sampler.sample(random_curve(ROPE, rng), parse_action("C(0,1,1)"), 1, rng)


def test_it_is_asked_for_nothing_that_was_not_demonstrated():
    icp = IcpSampler({}, IcpConfig())
    assert not any(has_capability(icp, name) for name in ("undo", "arrange", "values"))
