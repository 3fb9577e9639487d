"""How rope, table and gripper look: their colours and the light they lie in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.image import Label

if TYPE_CHECKING:
    from knotflow.perception.noise import CameraNoiseConfig

Colour = tuple[float, float, float]

HEAD_LENGTH = 0.05
"""Length of the coloured head, metres: two turns of tape."""


@dataclass(frozen=True)
class Appearance:
    """Colours are sRGB, 0 to 1; directions are of the world frame, z up."""

    rope: Colour = (0.85, 0.80, 0.68)
    table: Colour = (0.28, 0.36, 0.38)
    gripper: Colour = (0.12, 0.12, 0.13)
    head: Colour | None = None
    """Colour of the rope's first `HEAD_LENGTH`; None is a rope whose ends look alike."""
    light: tuple[float, float, float] = (0.2, -0.3, 1.0)
    """Direction towards the light."""
    ambient: float = 0.5
    """Share of the light that comes from everywhere, 0 to 1."""
    brightness: Colour = (1.0, 1.0, 1.0)
    """Strength of the light in red, green and blue: exposure and white balance."""
    grain: tuple[tuple[float, float, float, float], ...] = ()
    """The table's grain: waves of brightness, each a wave vector x and y (1/m), phase (radians) and
    amplitude (share of the brightness)."""

    @classmethod
    def draw(cls, rng: np.random.Generator, noise: CameraNoiseConfig) -> Appearance:
        """Colours and light at random; at level 0 the default ones.

        Rope, table and head differ by at least `noise.contrast / noise.level`, Euclidean in sRGB.
        """
        head = TAPE if noise.coloured_head else None
        level = noise.level
        if level == 0:
            return cls(head=head)
        while True:
            rope, table = rng.uniform(0.05, 0.95, (2, 3))
            shades = [rope, table, *([np.array(head)] if head else [])]
            apart = [np.linalg.norm(a - b) for i, a in enumerate(shades) for b in shades[:i]]
            if min(apart) >= noise.contrast / level:
                break
        tilt, azimuth = level * rng.uniform(0.0, noise.light_tilt), rng.uniform(0.0, 2 * np.pi)
        waves, angle = 4, rng.uniform(0.0, np.pi)
        length = rng.uniform(0.02, 0.3, waves)
        turn = angle + rng.normal(0.0, 0.2, waves)
        grain = np.column_stack(
            [
                2 * np.pi * np.cos(turn) / length,
                2 * np.pi * np.sin(turn) / length,
                rng.uniform(0.0, 2 * np.pi, waves),
                level * noise.grain * rng.uniform(0.0, 1.0, waves),
            ]
        )
        return cls(
            rope=_colour(rope),
            table=_colour(table),
            gripper=_colour(rng.uniform(0.05, 0.25) + rng.uniform(-0.03, 0.03, 3)),
            head=head,
            light=(
                float(np.sin(tilt) * np.cos(azimuth)),
                float(np.sin(tilt) * np.sin(azimuth)),
                float(np.cos(tilt)),
            ),
            ambient=float(rng.uniform(0.35, 0.65)),
            brightness=_colour(
                rng.uniform(0.75, 1.0) + level * rng.normal(0.0, noise.white_balance, 3)
            ),
            grain=tuple((float(x), float(y), float(phase), float(a)) for x, y, phase, a in grain),
        )

    def shade(
        self, labels: NDArray[np.uint8], head: NDArray[np.bool_], normals: NDArray, points: NDArray
    ) -> NDArray[np.uint8]:
        """The colours (H, W, 3) of what is seen, by Lambert's law.

        Args:
            labels: (H, W), see `Label`; unknown is black.
            head: (H, W), where the rope's head is seen.
            normals: (H, W, 3) unit, world frame.
            points: (H, W, 3) metres, world frame.
        """
        colours = np.zeros((len(Label), 3))
        colours[Label.TABLE] = self.table
        colours[Label.ROPE] = self.rope
        colours[Label.GRIPPER] = self.gripper
        rgb = colours[labels]
        if self.head is not None:
            rgb[head] = self.head
        light = np.array(self.light) / np.linalg.norm(self.light)
        shade = self.ambient + (1.0 - self.ambient) * (normals @ light).clip(0.0)
        table = labels == Label.TABLE
        x, y, _ = points[table].T
        for across, up, phase, amplitude in self.grain:
            shade[table] *= 1.0 + amplitude * np.sin(across * x + up * y + phase)
        rgb *= shade[..., None] * np.array(self.brightness)
        return np.rint(255.0 * rgb.clip(0.0, 1.0)).astype(np.uint8)


TAPE: Colour = (0.85, 0.10, 0.12)
"""Red tape around the rope's head."""


def _colour(values: NDArray) -> Colour:
    red, green, blue = (float(value) for value in values)
    return red, green, blue
