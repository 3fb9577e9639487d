"""What Causal InfoGAN learns from, rope shapes in the frames of their starts, and its settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.topology.polyline import Floats

CODE_DIM, NOISE_DIM = 7, 2
"""Dimensions of the latent code, uniform on [-1, 1], and of the generator's normal noise."""
FRAMES = 16
"""Shapes of a training rollout, evenly spaced in time; a pair is two neighbouring ones."""
PLAN_STEPS = 10
"""Steps of a plan through the latent space for each topological action."""


@dataclass
class CausalInfoGanConfig:
    """Networks, training and planning of one model; values of its authors where known."""

    width: int = 64
    """Channels of the generator's first layer; the others' layers are as wide or half of it."""
    batch: int = 100
    """Pairs of a gradient step."""
    steps: int = 9000
    """Gradient steps."""
    check_every: int = 500
    """Steps between two points of the training curves."""
    candidates: int = 100
    """Noises tried for a plan; the one the discriminator believes most is kept."""
    prior_samples: int = 4000
    """Generated shapes among which a projection looks for its first guesses."""
    restarts: int = 8
    """First guesses that a projection refines."""
    projection_steps: int = 300
    """Adam steps of a projection."""


@dataclass(frozen=True)
class StartFrame:
    """A frame on the table for each of B ropes, in which shapes do not depend on where it lies.

    The origin is below the start's centroid; the x axis is the direction of the straight rope, head
    at the negative end, that comes closest to the start vertex by vertex.
    """

    origin: Floats  # (B, 3) metres, world frame; z is 0
    rotation: Floats  # (B, 3, 3) its rows are the frame's axes in the world frame

    @classmethod
    def of(cls, starts: ArrayLike) -> StartFrame:
        """The frames of start shapes (B, V, 3), metres."""
        shapes = np.asarray(starts, dtype=np.float64)
        origin = shapes.mean(axis=1) * [1, 1, 0]
        along = np.linspace(-0.5, 0.5, shapes.shape[1])
        direction = np.einsum("v,bvk->bk", along, shapes - origin[:, None])
        angle = np.arctan2(direction[:, 1], direction[:, 0])
        rotation = np.zeros((len(shapes), 3, 3))
        rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(angle)
        rotation[:, 0, 1], rotation[:, 1, 0] = np.sin(angle), -np.sin(angle)
        rotation[:, 2, 2] = 1
        return cls(origin, rotation)

    def enter(self, shapes: NDArray[np.floating[Any]]) -> Floats:
        """World shapes (B, ..., V, 3) in these frames, metres."""
        moved = shapes - self._origin(shapes)
        turned: Floats = np.einsum("bij,b...j->b...i", self.rotation, moved)
        return turned

    def leave(self, shapes: NDArray[np.floating[Any]]) -> Floats:
        """Shapes (B, ..., V, 3) of these frames in the world frame, metres."""
        turned: Floats = np.einsum("bji,b...j->b...i", self.rotation, shapes)
        return turned + self._origin(shapes)

    def _origin(self, shapes: NDArray[np.floating[Any]]) -> Floats:
        return self.origin.reshape(len(self.origin), *([1] * (np.ndim(shapes) - 2)), 3)
