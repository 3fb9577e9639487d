"""The pinhole camera: projection of world points to pixels and back, and its YAML file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from knotflow.arrays import floats
from knotflow.topology.polyline import Floats

_MIN_BINNED = 16  # rows and columns left after binning, least
_SHAPES = {"position": (3,), "rotation": (3, 3)}
_HEADER = """\
# A pinhole camera. Sizes, focal lengths (fx, fy) and principal point (cx, cy) in pixels, of images
# without distortion; position in metres in the world frame (table at z = 0, z up). The rotation's
# columns are the camera's axes in the world: x right, y down in the image, z forward.
"""


class CameraError(ValueError):
    """An invalid camera or camera file."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera without distortion, at rest in the world.

    Pixel (u, v) counts columns from the left and rows from the top, pixel centres at whole numbers.
    The camera's axes are OpenCV's: x right, y down in the image, z forward along the optical axis.
    `position` (3,) is in metres, world frame, `rotation` (3, 3) world from camera, all else pixels.

    Raises:
        CameraError: values that are of another shape, not finite or impossible.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    position: Floats
    rotation: Floats

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            what, shape = f"a camera's {name}", _SHAPES.get(name, ())
            value = floats(getattr(self, name), what, CameraError)
            if value.shape != shape:
                kind = f"has shape {shape}" if shape else "is one number"
                raise CameraError(f"{what} {kind}, got {value.tolist()}")
            if not np.isfinite(value).all():
                raise CameraError(f"{what} must be finite, got {value.tolist()}")
            if name in ("width", "height", "fx", "fy") and value <= 0:
                raise CameraError(f"{what} is positive, got {value}")
            if name in ("width", "height"):
                if value != np.round(value):
                    raise CameraError(f"{what} is a whole number of pixels, got {value}")
                object.__setattr__(self, name, int(value))
            else:
                object.__setattr__(self, name, value if shape else float(value))
        off = np.abs(self.rotation.T @ self.rotation - np.eye(3)).max()
        if off > 1e-3 or np.linalg.det(self.rotation) < 0:
            raise CameraError(
                "a camera's rotation has orthogonal columns of length 1, the right-handed axes x "
                f"(right), y (down) and z (forward) in the world; got {self.rotation.tolist()}"
            )

    def project(self, points: ArrayLike) -> Floats:
        """Pixels u, v, NaN behind the camera, and depth along the optical axis (..., 3) of points
        (..., 3), metres."""
        local = (np.asarray(points, np.float64) - self.position) @ self.rotation
        depth = local[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = self.fx * local[..., 0] / depth + self.cx
            v = self.fy * local[..., 1] / depth + self.cy
        projected = np.stack([u, v, depth], axis=-1)
        projected[depth <= 0, :2] = np.nan
        return projected

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> Floats:
        """Points (..., 3), metres, at pixels (..., 2) with depths (...), metres."""
        return self.position + self._directions(pixels) * np.asarray(depth)[..., None]

    def nearest_pixels(self, points: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns (N,) of the pixels nearest to points (N, 3), metres, in the image."""
        u, v, _ = np.nan_to_num(self.project(points)).round().T
        return v.clip(0, self.height - 1).astype(int), u.clip(0, self.width - 1).astype(int)

    def rays(self) -> Floats:
        """Unit directions (height, width, 3) of the pixels' rays, world frame."""
        rays = self._pixel_directions
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def points(self, depth: ArrayLike) -> Floats:
        """Points (height, width, 3), metres, of a depth image (height, width), metres."""
        return self.position + self._pixel_directions * np.asarray(depth)[..., None]

    def on_plane(self, mask: NDArray[np.bool_], height: float) -> Floats:
        """Points (N, 2), metres, at which the rays of a mask's pixels (H, W) meet z = `height`."""
        rays = self.rays()[mask]
        reach = (height - self.position[2]) / np.minimum(rays[:, 2], -1e-9)
        return self.position[:2] + rays[:, :2] * reach[:, None]

    @cached_property
    def _pixel_directions(self) -> Floats:
        pixels = np.stack(np.meshgrid(np.arange(self.width), np.arange(self.height)), axis=-1)
        return self._directions(pixels)

    def _directions(self, pixels: ArrayLike) -> Floats:
        """Directions (..., 3) in the world of pixels (..., 2), of length 1 along the axis."""
        u, v = np.moveaxis(np.asarray(pixels, np.float64), -1, 0)
        local = np.stack(
            [(u - self.cx) / self.fx, (v - self.cy) / self.fy, np.ones_like(u)], axis=-1
        )
        return local @ self.rotation.T

    def binned(self, factor: int) -> Camera:
        """The camera whose pixels are `factor` by `factor` of this one's; a rest is cut off."""
        return replace(
            self,
            width=self.width // factor,
            height=self.height // factor,
            fx=self.fx / factor,
            fy=self.fy / factor,
            cx=(self.cx + 0.5) / factor - 0.5,
            cy=(self.cy + 0.5) / factor - 0.5,
        )

    def binning(self, points: NDArray, size: float, pixels: float) -> int:
        """The factor by which to bin so that a size, metres, at points (N, 3) is so many pixels."""
        distance = float(np.median(self.project(points)[:, 2]))
        if not distance > 0:
            return 1
        return self.feasible_binning(size * max(self.fx, self.fy) / distance / pixels)

    def feasible_binning(self, wanted: float) -> int:
        """The nearest factor, from 1 to what leaves an image to look at."""
        return max(1, min(round(wanted), min(self.width, self.height) // _MIN_BINNED))

    def cropped(self, rows: slice, columns: slice) -> Camera:
        """The camera whose image is these rows and columns of this one's."""
        top, bottom, _ = rows.indices(self.height)
        left, right, _ = columns.indices(self.width)
        width, height = right - left, bottom - top
        return replace(self, width=width, height=height, cx=self.cx - left, cy=self.cy - top)

    @classmethod
    def overhead(
        cls, width: int = 640, height: int = 480, distance: float = 1.2, field_of_view: float = 60.0
    ) -> Camera:
        """A camera `distance` metres above the middle of the table, the image's top towards +y; the
        `field_of_view`, degrees from top to bottom, is by default a Kinect v2's."""
        focal = float(0.5 * height / np.tan(np.deg2rad(field_of_view) / 2))
        centre = (width - 1) / 2, (height - 1) / 2
        position, rotation = np.array([0.0, 0.0, distance]), np.diag([1.0, -1.0, -1.0])
        return cls(width, height, focal, focal, *centre, position, rotation)

    def save(self, path: Path | str) -> None:
        """Write a file that `Calibration.load` reads."""
        values = {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in asdict(self).items()
        }
        text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None)
        Path(path).write_text(_HEADER + text, "utf-8")
