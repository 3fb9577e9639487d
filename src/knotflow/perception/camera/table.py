"""The table in a depth image: near z = 0 by a camera's pose, or wherever most of the image lies."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from knotflow.perception.camera.calibration import Calibration
from knotflow.perception.camera.pinhole import Camera
from knotflow.topology.polyline import Floats

MAX_OFFSET, MAX_TILT = 0.05, 0.1
"""Errors of a camera's pose that are corrected: metres in height, and radians."""
_OFFSET, _TILT = 0.008, 0.02
"""Larger ones are taken out of the pose; smaller ones, out of heights above the table alone."""
_PLANES = 300  # through three points, that are tried
_SAMPLE = 4000  # points at which they are compared
_LARGEST, _LEAST = 0.01, 0.002  # share of its distance, by which a point of the plane is off
_ROUNDS = 8


def find_table(depth: NDArray, calibration: Calibration) -> tuple[Floats, float, float]:
    """The plane on which most of a depth image (H, W) lies, NaN where unknown: by random sample
    consensus (Fischler and Bolles, 1981), then least squares on what is near.

    Returns:
        pose: world from camera (4, 4), the plane at z = 0, x the image's right, the origin what the
            middle of the image shows, lengths in the depth's unit.
        share, rms: of the depths that lie on it, 0..1, and their root mean square distance.
    """
    v, u = np.nonzero(np.isfinite(depth))
    rng = np.random.default_rng(0)
    chosen = rng.permutation(len(u))[: 10 * _SAMPLE]
    pixels, z = np.column_stack([u, v])[chosen], depth[v, u][chosen].astype(np.float64)
    points = np.column_stack([(pixels - calibration.centre) / calibration.focal, np.ones(len(z))])
    points *= z[:, None]
    triples = points[rng.integers(len(points), size=(_PLANES, 3))]
    planes = np.linalg.pinv(triples).sum(axis=2)  # (M, 3)
    near = np.abs(points[:_SAMPLE] @ planes.T - 1) < _LARGEST
    # Points P of a plane have plane (3,) . P = 1 in the camera's frame.
    plane, tolerance = planes[near.sum(axis=0).argmax()], _LARGEST
    for _ in range(_ROUNDS):
        off = np.abs(points @ plane - 1)
        on = off < tolerance
        if on.sum() < 3:
            break
        plane = np.linalg.lstsq(points[on], np.ones(on.sum()), rcond=None)[0]
        tolerance = float(np.clip(4 * np.median(off[on]), _LEAST, _LARGEST))
    size = np.linalg.norm(plane)
    off = (points @ plane - 1) / size
    on = np.abs(off) * size < tolerance
    rms = float(np.sqrt((off[on] ** 2).mean())) if on.any() else 0.0
    up = -plane / size
    right = np.array([1.0, 0.0, 0.0]) - up[0] * up
    right /= np.linalg.norm(right)
    middle = (np.array(depth.shape[::-1]) - 1) / 2
    ray = np.r_[(middle - calibration.centre) / calibration.focal, 1.0]
    pose = np.eye(4)
    pose[:3, :3] = right, np.cross(up, right), up
    pose[:3, 3] = -pose[:3, :3] @ ray / (plane @ ray)
    return pose, float(on.mean()), rms


def table_near_zero(depth: NDArray, camera: Camera) -> tuple[NDArray, NDArray | None]:
    """The points (H, W, 3) of a depth image (H, W), metres, and the plane z = a + b x + c y (3,)
    fitted to most of them; None where there are too few."""
    points = camera.points(depth)
    sample = points[::4, ::4][np.isfinite(depth[::4, ::4])]
    design, values = np.column_stack([np.ones(len(sample)), sample[:, :2]]), sample[:, 2]
    if len(values) < 3:
        return points, None
    plane = np.array([np.median(values), 0.0, 0.0])
    for tolerance in (0.04, 0.02, 0.01):
        table = np.abs(values - design @ plane) < tolerance
        if table.sum() < 3:
            break
        plane = np.linalg.lstsq(design[table], values[table], rcond=None)[0]
    return points, plane


@dataclass(frozen=True, eq=False)
class SeenTable:
    """The table as a camera's pose puts it: where it lies, with another than z = 0, is how far the
    pose is off."""

    middle: Floats
    """(3,) metres, of what the image shows."""
    slope: Floats
    """(2,) of z over x and y."""

    @classmethod
    def of(cls, depth: NDArray, camera: Camera) -> SeenTable:
        """The plane that fills most of a depth image (H, W), metres; z = 0 where too little depth
        is known."""
        points, plane = table_near_zero(depth, camera)
        if plane is None:
            return cls(np.zeros(3), np.zeros(2))
        x, y = np.nanmedian(points[..., :2], axis=(0, 1))
        return cls(np.array([x, y, plane @ [1.0, x, y]]), plane[1:])

    @property
    def offset(self) -> float:
        """Height of the middle, metres."""
        return float(self.middle[2])

    @property
    def tilt(self) -> float:
        """Angle to z = 0, radians."""
        return float(np.arctan(np.hypot(*self.slope)))

    @property
    def fits(self) -> bool:
        """Whether it is as near z = 0 as is corrected."""
        return abs(self.offset) <= MAX_OFFSET and self.tilt <= MAX_TILT

    def seated(self, camera: Camera) -> Camera:
        """The camera as it is above the table; itself within some millimetres and a degree."""
        if abs(self.offset) <= _OFFSET and self.tilt <= _TILT:
            return camera
        up = np.r_[-self.slope, 1.0] / np.sqrt(1.0 + self.slope @ self.slope)
        turn = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0].as_matrix()
        position = turn @ (camera.position - self.middle) + self.middle * [1.0, 1.0, 0.0]
        return replace(camera, position=position, rotation=turn @ camera.rotation)

    def __str__(self) -> str:
        return (
            f"{1e3 * self.offset:+.0f} mm above z = 0, tilted by "
            f"{np.rad2deg(self.tilt):.1f} degrees"
        )
