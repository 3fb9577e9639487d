"""Pictures of ropes with known crossings."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from skimage.measure import block_reduce

from knotflow.perception.estimation.skeleton import passages
from knotflow.topology import TopologicalState, project
from knotflow.topology.polyline import arc_lengths

_FINE = 2  # pictures are drawn on a grid this much finer

LINES = {
    "arc": [(0.1, 0.7), (0.3, 0.4), (0.6, 0.35), (0.9, 0.6)],
    "loop": [
        (0.1, 0.75), (0.45, 0.62), (0.8, 0.4), (0.6, 0.2), (0.4, 0.4), (0.6, 0.7), (0.9, 0.85),
    ],
    "overhand": [
        (0.05, 0.5), (0.35, 0.42), (0.7, 0.35), (0.85, 0.55), (0.55, 0.8), (0.25, 0.6),
        (0.35, 0.25), (0.5, 0.2), (0.58, 0.45), (0.62, 0.75), (0.68, 0.95),
    ],
    "pretzel": [
        (0.1, 0.9), (0.35, 0.65), (0.7, 0.5), (0.8, 0.2), (0.5, 0.15), (0.3, 0.4),
        (0.5, 0.75), (0.8, 0.8), (0.9, 0.6), (0.6, 0.3), (0.15, 0.15),
    ],
}  # fmt: skip
"""Control points of centre lines in shares of a picture's width and height."""


def centre_line(name: str, shape: tuple[int, int]) -> np.ndarray:
    """(N, 2) pixels, in a picture of `shape` (H, W), with even steps of about a pixel."""
    control = np.array(LINES[name]) * shape[::-1]
    knots = arc_lengths(control)
    knots = arc_lengths(control)
    dense = CubicSpline(knots, control)(np.linspace(0, knots[-1], 4000))
    along = arc_lengths(dense)
    even = np.linspace(0, along[-1], int(along[-1]))
    return np.column_stack([np.interp(even, along, one) for one in dense.T])


def state_of(line: np.ndarray, first_over: list[bool]) -> TopologicalState:
    """The state of a line (N, 2) whose crossings, in order, have their first strand over."""
    flat = np.pad(line * [1, -1], ((0, 0), (0, 1)))
    for (first, second), over in zip(crossings_of(line), first_over, strict=True):
        at = round(first if over else second)
        flat[max(0, at - 3) : at + 4, 2] = 1.0
    return TopologicalState.from_crossings(project(flat, min_gap=0.5).crossings)


def crossings_of(line: np.ndarray) -> np.ndarray:
    met = passages(np.pad(line, ((0, 0), (0, 1))))
    return met[np.argsort(met[:, 0])]


def photograph(
    line: np.ndarray,
    first_over: list[bool],
    shape: tuple[int, int],
    *,
    width: float = 9.0,
    colour: tuple[float, float, float] = (200, 120, 110),
    table: tuple[float, float, float] = (25, 25, 25),
    shading: float = 0.5,
    shadow: float = 0.4,
    noise: float = 3.0,
    blur: float = 0.7,
    grain: float = 0.0,
    light: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """(H, W, 3) uint8 of a rope along a line (N, 2), pixels. `shading` darkens its borders,
    `shadow` what lies beside an upper strand; `grain` is the table's texture, `light` how much
    darker one side of the picture is, all shares but `noise` (8 bits) and `blur` (pixels)."""
    rng = np.random.default_rng(seed)
    across = shape[1]
    texture = 1 + grain * ndimage.gaussian_filter(rng.standard_normal(shape), (0.5, 6)) * 3
    picture = np.repeat(np.repeat(texture, _FINE, 0), _FINE, 1)[..., None] * np.array(table)
    rows, columns = np.indices(picture.shape[:2])
    pixels = (np.column_stack([columns.ravel(), rows.ravel()]) + 0.5) / _FINE - 0.5

    def paint(part: np.ndarray, lifted: bool) -> None:
        off, nearest = cKDTree(part).query(pixels, distance_upper_bound=2 * width)
        if lifted:  # not around its ends, where the strand goes on
            off[(nearest == 0) | (nearest == len(part) - 1)] = np.inf
        off = off.reshape(picture.shape[:2]) / (width / 2)
        beside = np.isfinite(off) & (off > 1)
        if lifted:
            dark = 1 - shadow * np.exp(-(off[beside] - 1) / 0.4)
            picture[beside] *= dark[:, None]
        on = off <= 1
        picture[on] = (1 - shading * off[on] ** 4)[:, None] * np.array(colour)

    paint(line, False)
    for (first, second), over in zip(crossings_of(line), first_over, strict=True):
        at, reach = round(first if over else second), int(1.5 * width)
        paint(line[max(0, at - reach) : at + reach + 1], True)
    small = block_reduce(picture, (_FINE, _FINE, 1), np.mean)
    small *= 1 - light * np.linspace(0, 1, across)[None, :, None]
    small = ndimage.gaussian_filter(small, (blur, blur, 0))
    small += noise * rng.standard_normal(small.shape)
    return small.round().clip(0, 255).astype(np.uint8)
