"""What a fitted rope trades: points that it leaves for bends that are even."""

from __future__ import annotations

import numpy as np

from knotflow.planning.rope import fit as fitting
from knotflow.planning.rope.fit import STIFFNESS, fit_rope, rests
from knotflow.simulation import RopeConfig, random_curve, straight


def test_stiffness_is_the_rate_at_which_links_off_are_exchanged_for_radians(monkeypatch):
    rope = RopeConfig()
    curve = random_curve(rope, np.random.default_rng(0))[::4, :2]  # its corners cannot be followed
    curve *= rope.length / np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    values, off, uneven = (0.0, STIFFNESS, 0.3, 3.0), [], []
    for value in values:
        monkeypatch.setattr(fitting, "STIFFNESS", value)
        fit = fit_rope(curve, np.zeros(0, bool), rope)
        x, y = np.diff(fit.points[:, :2], axis=0).T
        bends = np.diff(np.unwrap(np.arctan2(y, x)))
        off.append(np.square(fit.deviations / rope.link_length).sum())
        uneven.append(np.square(np.diff(bends)).sum())
    assert (np.diff(uneven) < 0).all()
    # Each is the best at its own rate, so that neither gains by being the other.
    rate = np.sqrt((off[3] - off[2]) / (uneven[2] - uneven[3]))
    assert values[2] < rate < values[3]


def test_a_rope_at_rest_is_bent_no_more_than_it_can_be_and_lies_on_the_table():
    rope = RopeConfig()
    points = straight(rope)
    for bend in (0.99 * rope.max_bend, 1.01 * rope.max_bend):
        bent = points.copy()
        corner = bent[20:] - bent[20]
        turn = np.array([[np.cos(bend), -np.sin(bend)], [np.sin(bend), np.cos(bend)]])
        bent[20:, :2] = bent[20, :2] + corner[:, :2] @ turn.T
        assert rests(bent, rope) == (bend < rope.max_bend)
    rises = points * [1.0, 1.0, 0.0] + np.linspace([0, 0, 0], [0, 0, rope.radius], len(points))
    assert rests(points, rope) and not rests(rises, rope) and not rests(points[1:], rope)
