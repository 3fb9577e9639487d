"""The first baseline: splines drawn from the whole parameter space (Sec. VII-A2)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from knotflow.samplers.sampler import NoSettings, sampler
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW
from knotflow.topology import Action
from knotflow.topology.polyline import Floats


class RandomSampler:
    """Uniform over every spline in range, whatever the rope and the action."""

    def sample(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        return rng.uniform(SPLINE_LOW, SPLINE_HIGH, (count, 6))


@sampler("random")
def build(config: NoSettings, inputs: Mapping[str, Path]) -> RandomSampler:
    """Requires no input."""
    return RandomSampler()
