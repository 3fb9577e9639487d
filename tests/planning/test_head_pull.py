"""An overhand whose head is pulled out, with an obedient rope."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.planning import head_pull
from knotflow.planning.head_pull import loop_area, pull_head
from knotflow.simulation import Rollouts
from knotflow.topology import TopologicalState, segment_lengths

OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")


def test_pulls_grasp_the_head_and_other_points_of_the_rope(shape_of, rng):
    points = shape_of(OVERHAND)
    splines = head_pull._random_pulls(points, rng)
    at_head = splines[:, 0] == 0
    assert 0 < at_head.sum() < len(splines)
    outward = points[0, :2] - points[2, :2]
    assert ((splines[at_head, 4:] - points[0, :2]) @ outward).mean() > 0


class Rope:
    """The first pulls lead to the shapes of a list, whatever they are; all others fail."""

    def __init__(self, config, shapes):
        self.config, self.shapes = config, shapes

    def execute(self, points, splines):
        count = len(splines)
        ends = points.copy()
        ends[: len(self.shapes)], self.shapes = self.shapes or points[:0], []
        return Rollouts(
            times=np.array([0.0, 1.0]),
            trajectory=np.stack([ends, ends], axis=1).astype(np.float32),
            gripper=ends[:, :2].astype(np.float32),
            frames=np.full(count, 2),
            release_times=np.ones(count),
            end_points=ends,
            diverged=np.zeros(count, bool),
        )


@pytest.mark.slow
def test_shape_nearest_to_the_wanted_lengths_is_kept(world, shape_of, rng, monkeypatch):
    points, config = shape_of(OVERHAND), world.config
    head, *inner, _ = segment_lengths(points) * config.rope.length
    monkeypatch.setattr(head_pull, "LEAST_HEAD", 0.9 * head)
    monkeypatch.setattr(head_pull, "LEAST_SEGMENT", 0.9 * min(inner))
    assert pull_head(points, Rope(config, []), rng) is points  # nothing to do
    monkeypatch.setattr(head_pull, "LEAST_SEGMENT", 1.1 * min(inner))
    assert pull_head(points, Rope(config, []), rng) is None
    lost = shape_of(TopologicalState.parse("1o3+4o2+"))  # another state, whatever its lengths
    assert pull_head(points, Rope(config, [lost]), rng) is None


def test_of_all_pulls_that_keep_the_state_the_one_with_the_longest_head_is_kept(
    world, long_headed_shape_of, rng, monkeypatch
):
    lost = long_headed_shape_of(TopologicalState.parse("1o3+4o2+"), 0.8)
    start, long, longest, other = (
        long_headed_shape_of(OVERHAND, share) for share in (0.0, 0.2, 0.4, 0.1)
    )
    head, *inner, _ = segment_lengths(longest) * world.config.rope.length
    monkeypatch.setattr(head_pull, "LEAST_HEAD", 0.99 * head)
    monkeypatch.setattr(head_pull, "LEAST_SEGMENT", 0.5 * min(inner))
    monkeypatch.setattr(head_pull, "ROUNDS", 2)
    pulled = pull_head(start, Rope(world.config, [long, longest, lost, other]), rng)
    np.testing.assert_array_equal(pulled, longest)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_area_of_the_loop_grows_with_its_square_and_leaves_out_the_ends(shape_of, scale):
    points = shape_of(OVERHAND)
    area = loop_area(points)
    assert loop_area(points * (scale, scale, 1)) == pytest.approx(scale**2 * area)
    assert area < np.prod(np.ptp(points[:, :2], axis=0))
