"""Which strand of a crossing is on top, from colours alone.

The upper strand goes on as it looks beside the crossing, and so do its two borders; the lower one's
end there. The log odds are those of both ratios: of how far the crossing's colours are from those
beside it along each strand, and of how marked each strand's borders are within the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from knotflow.perception.camera.image import interpolated
from knotflow.topology.polyline import Floats, interpolate

_REACH, _STEP = 2.5, 1 / 12  # rope widths along and across a strand
_ACROSS, _CORE = 0.75, 0.4
_BESIDE = 1.0  # widths from the other strand, from where a strand looks as it does alone
_BORDER, _INNER = 0.25, 0.33  # widths: about a border, and from the axis of the strand it crosses
_ALONG = 3.0  # steps along a strand over which its borders are averaged
_FLOOR, _EDGE_FLOOR = 2.0, 0.5  # CIELAB: differences that noise makes, in colour and at a border
_ODDS = 3.0, 7.0  # log odds per unit of the log ratios of colours and of borders


@dataclass(frozen=True, eq=False)
class _Strip:
    """A strand around a crossing, straightened: places `along` it (S,) and `across` (T,), pixels
    (S, T, 2) of the image, and their distance from the other strand's axis `off` (S, T), widths."""

    along: Floats
    across: Floats
    pixels: Floats
    off: Floats


def occlusion_odds(
    lab: NDArray[np.float32], line: Floats, passes: tuple[float, float], width: float
) -> float:
    """Log odds that the first of two passes is over the second, in CIELAB colours (H, W, 3).

    The rope's centre `line` (N, 2) has even steps, pixels, and crosses itself at the indices
    `passes`, between its points; it is `width` pixels wide.
    """
    axes = [_axis(line, at, width) for at in passes]
    surprise, edge = [], []
    for own, other in (axes, axes[::-1]):
        strip = _strip(own, other, width)
        colours = interpolated(lab, strip.pixels)
        surprise.append(_surprise(strip, colours) + _FLOOR**2)
        edge.append(_edge(strip, colours) + _EDGE_FLOOR)
    ratios = np.log([surprise[1] / surprise[0], edge[0] / edge[1]])
    return float(ratios @ _ODDS)


def _axis(line: Floats, at: float, width: float) -> tuple[Floats, Floats, Floats]:
    """Places (S,) along the line about one of its indices, widths, the points (S, 2) there, and
    the normals (S, 2)."""
    step = float(np.linalg.norm(np.diff(line, axis=0), axis=1).mean())
    along = np.arange(-_REACH, _REACH + _STEP / 2, _STEP)
    index = np.arange(len(line))
    points = interpolate(at + along * width / step, index, line)
    tangent = np.gradient(ndimage.gaussian_filter1d(points, 0.5 / _STEP, 0, mode="nearest"), axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-9
    return along, points, np.stack([-tangent[:, 1], tangent[:, 0]], 1)


def _strip(
    own: tuple[Floats, Floats, Floats], other: tuple[Floats, Floats, Floats], width: float
) -> _Strip:
    along, points, normals = own
    across = np.arange(-_ACROSS, _ACROSS + _STEP / 2, _STEP)
    pixels = points[:, None] + width * across[:, None] * normals[:, None]  # (S, T, 2)
    _, nearest = cKDTree(other[1]).query(pixels)
    off = ((pixels - other[1][nearest]) * other[2][nearest]).sum(-1) / width
    return _Strip(along, across, pixels, np.abs(off))


def _surprise(strip: _Strip, colours: Floats) -> float:
    """Mean squared difference at the crossing from the strand's colours (S, T, 3) on both sides,
    at the same place across."""
    core = np.flatnonzero(np.abs(strip.across) <= _CORE)
    errors = []
    for column in core:
        beside = strip.off[:, column] > _BESIDE
        sides = [np.flatnonzero(beside & (np.sign(strip.along) == sign)) for sign in (-1, 1)]
        if min(len(side) for side in sides) < 3:
            continue
        before, after = (colours[side, column].mean(0) for side in sides)
        start, end = (float(strip.along[side].mean()) for side in sides)
        within = strip.off[:, column] < 0.5
        share = (strip.along[within, None] - start) / (end - start)
        expected = before + share * (after - before)
        errors += ((colours[within, column] - expected) ** 2).sum(1).tolist()
    return float(np.mean(errors)) if errors else 0.0


def _edge(strip: _Strip, colours: Floats) -> float:
    """How much colours (S, T, 3) change at the strand's two borders, within the other strand."""
    smooth = ndimage.gaussian_filter1d(colours, _ALONG, axis=0)
    change = np.linalg.norm(ndimage.gaussian_filter1d(smooth, 1, axis=1, order=1), axis=-1)
    marked = []
    for side in (-1, 1):
        border = np.abs(side * strip.across - 0.5) < _BORDER
        within = (strip.off < _INNER)[:, border]
        whole = within.sum(1) >= 4
        strongest = np.where(within, change[:, border], 0.0).max(1)
        marked.append(float(strongest[whole].mean()) if whole.any() else 0.0)
    return float(np.mean(marked))
