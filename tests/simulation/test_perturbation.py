"""What is drawn stays in its stated range, and nothing else changes."""

from dataclasses import fields

import numpy as np
import pytest

from knotflow.simulation import EXPONENTS, LEVELS, RopeConfig, perturb_rope


def test_level_0_changes_nothing(rng):
    assert perturb_rope(RopeConfig(), 0, rng) == RopeConfig()


@pytest.mark.parametrize("level", LEVELS)
def test_factors_are_log_uniform(level, rng):
    rope = RopeConfig()
    drawn = [perturb_rope(rope, level, rng) for _ in range(400)]
    for field in fields(rope):
        values = [getattr(one, field.name) for one in drawn]
        if field.name not in EXPONENTS:
            assert set(values) == {getattr(rope, field.name)}
            continue
        logs = np.log(np.array(values) / getattr(rope, field.name))
        widest = level * EXPONENTS[field.name]
        assert np.abs(logs).max() <= widest + 1e-12
        assert logs.std() == pytest.approx(widest / np.sqrt(3), rel=0.1, abs=1e-12)


def test_unknown_level_is_rejected(rng):
    with pytest.raises(ValueError, match="unknown level 3; valid levels: 0, 1, 2"):
        perturb_rope(RopeConfig(), 3, rng)
