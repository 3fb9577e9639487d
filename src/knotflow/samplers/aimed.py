"""The scripted demonstrator's first guess as a sampler: knowledge without learning.

Not a baseline of the paper. It shows what the strategy of Sec. V-A is worth by itself, and makes
the starts that no learned method has touched.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations import aim
from knotflow.samplers.sampler import sampler
from knotflow.topology import Action


@dataclass
class AimedConfig:
    """Aiming has nothing to set."""


class AimedSampler:
    """Grasps the segment that will be over and moves across the one that will be under."""

    def sample(
        self, points: NDArray, action: Action, count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Splines (count, 6) in range, see `demonstrations.aim`."""
        return aim(points, action, count, rng)


@sampler("aimed")
def build(config: AimedConfig, inputs: Mapping[str, Path]) -> AimedSampler:
    """Needs nothing."""
    return AimedSampler()
