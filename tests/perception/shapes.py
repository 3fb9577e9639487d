"""Rope shapes for tests of perception, and images of them without a simulator's noise."""

from dataclasses import replace

import numpy as np
import torch

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.evidence import Target
from knotflow.perception.networks.windows import Patch, project_to_plane
from knotflow.simulation import RopeConfig, resample

ROPE = RopeConfig(radius=0.008)
CAMERA = Camera.overhead(320, 240)


def s_curve() -> np.ndarray:
    """A rope (V, 3) flat on the table, without crossings."""
    t = np.linspace(0, 1, 200)
    return _rope(0.9 * t - 0.45, 0.1 * np.sin(2 * np.pi * t), 0 * t)


def loop(over: int = 1) -> np.ndarray:
    """A rope (V, 3) with one crossing, whose later strand is on top for `over` = 1."""
    t = np.linspace(0, 1, 400)
    angle = 2.0 * np.pi * (t - 0.5)
    x = 0.45 * (t - 0.5) - 0.16 * np.sin(angle) * np.exp(-((2 * t - 1) ** 2) * 1.5)
    y = 0.16 * np.cos(angle) * np.exp(-((2 * t - 1) ** 2) * 1.5)
    first, second = _meeting(x, y)
    at = t[second] if over == 1 else t[first]
    return _rope(x, y, 2.1 * ROPE.radius * np.exp(-(((t - at) / 0.05) ** 2)))


def seen_exactly(
    points: np.ndarray, camera: Camera = CAMERA, radius: float = ROPE.radius
) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) of rope and table along the optical axis, metres, and where the rope is.

    Worked out by marching along the rays, in another way than the renderer does.
    """
    rays = camera.rays()
    axis = rays @ camera.rotation[:, 2]
    fine = np.linspace(0, len(points) - 1, 12 * (len(points) - 1) + 1)
    balls = np.stack([np.interp(fine, np.arange(len(points)), points[:, k]) for k in range(3)], 1)
    table = -camera.position[2] / rays[..., 2] * axis
    depth = table.copy()
    centre = balls - camera.position
    column, row, _ = camera.project(balls).T
    for ball, u, v in zip(centre, column.round().astype(int), row.round().astype(int), strict=True):
        window = np.s_[max(0, v - 4) : v + 5, max(0, u - 4) : u + 5]
        along = rays[window] @ ball
        square = radius**2 - (ball @ ball - along**2)
        hit = square > 0
        entered = (along - np.sqrt(square.clip(0))) * axis[window]
        depth[window] = np.where(hit, np.minimum(depth[window], entered), depth[window])
    return depth, depth < table - 1e-6


def target(points: np.ndarray) -> Target:
    """What a perfect image says of a rope."""
    depth, mask = seen_exactly(points)
    height = (CAMERA.position[2] - depth).astype(np.float32)
    seen = (mask, np.ones_like(mask), depth, height, mask.astype(float))
    return Target(CAMERA, ROPE, *(torch.as_tensor(one) for one in seen))


def bare() -> Target:
    """What an image of the table alone says."""
    seen = target(s_curve())
    return replace(seen, mask=seen.mask & False, coverage=0 * seen.coverage)


def image(points: np.ndarray, head: bool = False, radius: float = ROPE.radius) -> RgbdImage:
    """A perfect image of a light rope, whose first 50 mm may be red, on a dark table."""
    depth, mask = seen_exactly(points, radius=radius)
    rgb = np.full((*mask.shape, 3), 60, np.uint8)
    rgb[mask] = (220, 210, 180)
    if head:
        column, row, _ = CAMERA.project(points[:3]).T
        v, u = np.nonzero(mask)
        near = np.hypot(u[:, None] - column, v[:, None] - row).min(axis=1) < 4
        rgb[v[near], u[near]] = (210, 25, 30)
    return RgbdImage(rgb, depth.astype(np.float32))


def shape_error(points: np.ndarray, truth: np.ndarray) -> float:
    """Mean distance of vertices (V, 3), from the nearer end, metres."""
    return min(np.linalg.norm(points[::way] - truth, axis=1).mean() for way in (1, -1))


def nodes_in(patch: Patch, points: np.ndarray) -> np.ndarray:
    """Nodes (V, 3) of a patch of points (V, 3) seen by `CAMERA`: the inverse of `to_world`."""
    places = project_to_plane(points, CAMERA.position, patch.radius)
    return np.column_stack([(places - patch.centre) / patch.half, points[:, 2] / patch.radius])


def _rope(x: np.ndarray, y: np.ndarray, lift: np.ndarray) -> np.ndarray:
    return resample(np.stack([x, y, ROPE.radius + lift], axis=1), ROPE)


def _meeting(x: np.ndarray, y: np.ndarray) -> tuple[int, int]:
    apart = np.hypot(x[:, None] - x, y[:, None] - y)
    apart[np.abs(np.subtract.outer(np.arange(len(x)), np.arange(len(x)))) < 100] = np.inf
    first, second = np.unravel_index(apart.argmin(), apart.shape)
    return min(first, second), max(first, second)
