"""Where two fingers fit between the strands of a rope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from knotflow.topology.polyline import Floats, arc_lengths, interpolate

SPACING = 0.004  # of the points that stand for other strands, lengths of a rope of 1 m


@dataclass
class HandConfig:
    """Two parallel fingers, which close across the strand that they grasp."""

    opening: float = 0.05
    """Largest distance between the fingers, metres; narrower where neighbours are near."""
    thickness: float = 0.008
    """Of a finger, across the strand, metres."""
    width: float = 0.02
    """Of a finger, along the strand, metres."""
    clearance: float = 0.002
    """Between the open fingers and the grasped strand on either side, metres."""

    def scaled(self, unit: float) -> HandConfig:
        """The same hand in another unit, metres."""
        return HandConfig(*(value / unit for value in vars(self).values()))


def openings(points: Floats, links: ArrayLike, radius: float, hand: HandConfig) -> Floats:
    """How far the fingers can open around links (N,) of a rope (V, 3), metres: (N,).

    They reach down to the table, so a strand between them, or under or over the grasped link,
    leaves no room; 0 where the grasped strand itself does not fit.
    """
    vertices, links = np.asarray(points, float), np.asarray(links, np.intp)
    at = arc_lengths(vertices)
    along = np.arange(0.0, at[-1] + SPACING, SPACING)
    strand = interpolate(along, at, vertices[:, :2])
    begin, end = vertices[links, :2], vertices[links + 1, :2]
    tangent = (end - begin) / np.maximum(np.linalg.norm(end - begin, axis=1), 1e-9)[:, None]
    offset = strand - (begin + end)[:, None] / 2  # (N, S, 2)
    ahead = np.abs((offset * tangent[:, None]).sum(-1))
    aside = np.abs((offset * tangent[:, None, ::-1] * [-1.0, 1.0]).sum(-1))
    own = (
        np.abs(along - (at[links] + at[links + 1])[:, None] / 2) <= hand.width / 2 + np.pi * radius
    )
    beside = (ahead <= hand.width / 2 + radius) & ~own
    nearest = np.where(beside, aside, np.inf).min(axis=1)
    room = np.minimum(hand.opening, 2 * (nearest - hand.thickness - radius))
    return np.where(room >= 2 * (radius + hand.clearance), room, 0.0)
