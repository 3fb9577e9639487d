"""The pinhole camera: where a point of the world is seen, and where a pixel looks."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from operator import index
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from knotflow.arrays import floats


class CameraError(ValueError):
    """A camera, or a camera's file, that does not make sense."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera without distortion, at rest in the world.

    Pixel (u, v) counts columns from the left and rows from the top; pixel (0, 0) has its centre at
    (0, 0), so an image covers -0.5 to width - 0.5. The camera's axes are OpenCV's: x right, y down
    in the image, z forward along the optical axis.

    Attributes:
        width, height: size of the image, pixels.
        fx, fy: focal lengths, pixels.
        cx, cy: principal point, pixels.
        position: (3,) metres, the optical centre in the world frame.
        rotation: (3, 3), world from camera: its columns are the camera's axes in the world.

    Raises:
        CameraError: a size or focal length that is not positive, a value that is not finite, or a
            rotation that is none.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, shape in (("position", (3,)), ("rotation", (3, 3))):
            value = floats(getattr(self, name), f"a camera's {name}", CameraError)
            if value.shape != shape:
                raise CameraError(f"a camera's {name} has shape {shape}, got {value.shape}")
            object.__setattr__(self, name, value)
        for name in ("width", "height"):
            try:
                object.__setattr__(self, name, index(getattr(self, name)))
            except TypeError:
                raise CameraError(
                    f"a camera's {name} is a whole number of pixels, got {getattr(self, name)!r}"
                ) from None
        for name in ("fx", "fy", "cx", "cy"):
            value = floats(getattr(self, name), f"a camera's {name}", CameraError)
            if value.ndim:
                raise CameraError(f"a camera's {name} is one number, got {value.tolist()}")
            object.__setattr__(self, name, float(value))
        for name in ("width", "height", "fx", "fy"):
            if not getattr(self, name) > 0:
                raise CameraError(f"a camera's {name} is positive, got {getattr(self, name)}")
        for field in fields(self):
            if not np.isfinite(getattr(self, field.name)).all():
                raise CameraError(f"a camera's {field.name} must be finite")
        off = np.abs(self.rotation.T @ self.rotation - np.eye(3)).max()
        if off > 1e-3 or np.linalg.det(self.rotation) < 0:
            raise CameraError(
                "a camera's rotation has orthogonal columns of length 1, the right-handed axes x "
                f"(right), y (down) and z (forward) in the world; got {self.rotation.tolist()}"
            )

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Where points (..., 3), metres, world frame, are seen.

        Returns:
            (..., 3): u and v in pixels, and the depth along the optical axis in metres. Pixels of
            points that are not in front of the camera (depth <= 0) are NaN.
        """
        local = (np.asarray(points, np.float64) - self.position) @ self.rotation
        depth = local[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = self.fx * local[..., 0] / depth + self.cx
            v = self.fy * local[..., 1] / depth + self.cy
        seen = np.stack([u, v, depth], axis=-1)
        seen[depth <= 0, :2] = np.nan
        return seen

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """The points (..., 3), metres, world frame, that are seen at pixels (..., 2) with depths
        (...), metres along the optical axis."""
        return self.position + self._directions(pixels) * np.asarray(depth)[..., None]

    def rays(self) -> NDArray[np.float64]:
        """The unit directions (height, width, 3), world frame, in which the pixels look."""
        return self._everywhere / np.linalg.norm(self._everywhere, axis=-1, keepdims=True)

    def points(self, depth: ArrayLike) -> NDArray[np.float64]:
        """The points (height, width, 3), metres, world frame, that the pixels of a depth image
        (height, width) show, metres along the optical axis."""
        return self.position + self._everywhere * np.asarray(depth)[..., None]

    @cached_property
    def _everywhere(self) -> NDArray[np.float64]:
        """The directions (height, width, 3) of all pixels."""
        pixels = np.stack(np.meshgrid(np.arange(self.width), np.arange(self.height)), axis=-1)
        return self._directions(pixels)

    def _directions(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Directions (..., 3) in the world of pixels (..., 2), of length 1 along the axis."""
        u, v = np.moveaxis(np.asarray(pixels, np.float64), -1, 0)
        local = np.stack(
            [(u - self.cx) / self.fx, (v - self.cy) / self.fy, np.ones_like(u)], axis=-1
        )
        return local @ self.rotation.T

    def binned(self, factor: int) -> Camera:
        """The camera whose pixels are squares of `factor` by `factor` of this one's; what is left
        over at the right and at the bottom is cut off."""
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
        """How many pixels to bin along each side so that something of that size, metres, at points
        (N, 3) is about so many pixels across; 1 where it is smaller already, and no more than leave
        `_FEWEST` rows and columns."""
        distance = float(np.median(self.project(points)[:, 2]))
        if not distance > 0:
            return 1
        wanted = round(size * max(self.fx, self.fy) / distance / pixels)
        return max(1, min(wanted, min(self.width, self.height) // _FEWEST))

    def cropped(self, rows: slice, columns: slice) -> Camera:
        """The camera whose image is these rows and columns of this one's."""
        top, bottom, _ = rows.indices(self.height)
        left, right, _ = columns.indices(self.width)
        return replace(
            self,
            width=right - left,
            height=bottom - top,
            cx=self.cx - left,
            cy=self.cy - top,
        )

    @classmethod
    def overhead(
        cls, width: int = 320, height: int = 240, distance: float = 1.2, field_of_view: float = 60.0
    ) -> Camera:
        """A camera above the middle of the table that looks down, the image's top towards +y.

        With the defaults, a Kinect v2's field of view, it sees all that a spline reaches: 0.6 m
        from the middle in x and y, up to 0.15 m above the table. A pixel is 5.8 mm on the table.

        Args:
            width, height: pixels; at least as wide as high.
            distance: metres above the table.
            field_of_view: from the image's top to its bottom, degrees.
        """
        focal = 0.5 * height / np.tan(np.deg2rad(field_of_view) / 2)
        return cls(
            width=width,
            height=height,
            fx=float(focal),
            fy=float(focal),
            cx=(width - 1) / 2,
            cy=(height - 1) / 2,
            position=np.array([0.0, 0.0, distance]),
            rotation=np.diag([1.0, -1.0, -1.0]),
        )

    @classmethod
    def load(cls, path: Path | str) -> Camera:
        """The camera of a YAML file that has every attribute by name.

        Raises:
            CameraError: the file cannot be read, lacks a value, has one that is unknown, or
                values that make no camera.
        """
        path = Path(path)
        try:
            values = yaml.safe_load(path.read_text("utf-8"))
        except (OSError, ValueError, yaml.YAMLError) as error:
            raise CameraError(f"{path}: cannot be read as a camera's YAML file: {error}") from error
        names = [field.name for field in fields(cls)]
        if not isinstance(values, dict):
            raise CameraError(f"{path}: a camera file has the values {', '.join(names)}")
        missing = [name for name in names if values.get(name) is None]
        unknown = [str(name) for name in values if name not in names]
        if missing or unknown:
            what = f"lacks {', '.join(missing)}" if missing else f"has unknown {', '.join(unknown)}"
            raise CameraError(f"{path}: {what}; a camera has {', '.join(names)}")
        try:
            return cls(**{name: _number(name, value) for name, value in values.items()})
        except CameraError as error:
            raise CameraError(f"{path}: {error}") from error

    def save(self, path: Path | str) -> None:
        """Writes the file that `load` reads."""
        values = {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in asdict(self).items()
        }
        Path(path).write_text(
            _HEADER + yaml.safe_dump(values, sort_keys=False, default_flow_style=None), "utf-8"
        )


_FEWEST = 16  # rows and columns that are left after binning

_HEADER = """\
# A pinhole camera. Sizes, focal lengths (fx, fy) and principal point (cx, cy) in pixels, of images
# without distortion; position in metres in the world frame (table at z = 0, z up). The rotation's
# columns are the camera's axes in the world: x right, y down in the image, z forward.
"""

_DIMENSIONS = {"position": 1, "rotation": 2}


def _number(name: str, value: Any) -> Any:
    """A value of a camera file as int, float or array."""
    array = floats(value, name, CameraError)
    if name in _DIMENSIONS:
        return array
    if array.ndim:
        raise CameraError(f"{name} is one number, got {value!r}")
    if name not in ("width", "height"):
        return float(array)
    if not np.isfinite(array) or array != np.round(array):
        raise CameraError(f"{name} is a whole number of pixels, got {value!r}")
    return int(array)
