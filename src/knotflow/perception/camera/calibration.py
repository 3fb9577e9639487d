"""Calibration files of cameras: OpenCV and ROS YAML, RealSense and Open3D JSON, and our own."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from knotflow.arrays import floats
from knotflow.perception.camera.image import FARTHEST, interpolated
from knotflow.perception.camera.pinhole import Camera, CameraError
from knotflow.topology.polyline import Floats

_SECTIONS = {
    *("intrinsic", "intrinsics", "color", "colour", "rgb", "colorintrinsics", "camerainfo"),
    *("cam0", "pose", "transform"),
}
"""Mappings whose values are read as if they stood beside them."""
_MATRIX = ("cameramatrix", "intrinsicmatrix", "k", "intrinsics", "intrinsic", "mtx")
_DISTORTION = (
    *("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoeff", "distortion"),
    *("dist", "d", "coeffs"),
)
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")  # OpenCV's
_WORLD_FROM_CAMERA = ("pose", "transform", "cameratoworld", "cam2world", "c2w", "tworldcamera")
_CAMERA_FROM_WORLD = ("extrinsic", "extrinsics", "worldtocamera", "world2cam", "w2c")
_POSITION, _ROTATION = ("position", "translation"), ("rotation", "quaternion", "orientation")
_REALSENSE = ("none", "modifiedbrownconrady", "inversebrownconrady", "ftheta", "brownconrady")
_BROWN = (
    *("", "none", "plumbbob", "brownconrady", "modifiedbrownconrady", "radtan", "pinhole"),
    *("rationalpolynomial", "opencv"),
)
_FISHEYE = ("equidistant", "fisheye", "kannalabrandt", "kannalabrandt4")
_ROUNDS = 20  # of inverting a distortion


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera's calibration; `focal` and `centre`, pixels, are x and y of the size
    (width, height) that images have, if it is known."""

    focal: tuple[float, float]
    centre: tuple[float, float]
    size: tuple[int, int] | None = None
    distortion: Floats = field(default_factory=lambda: np.zeros(0))
    """Coefficients in OpenCV's order, k1 k2 p1 p2 k3 ...; empty without distortion."""
    model: str = ""
    """"" is Brown-Conrady's, "inverse" maps distorted to undistorted, "fisheye" is equidistant."""
    poses: tuple[Floats, ...] = ()
    """(4, 4) world from camera, metres; several where a quaternion's order is not known."""
    depth_unit: float | None = None
    """Metres."""
    source: str = "camera"
    """Its file, for messages."""

    @classmethod
    def load(cls, path: Path | str) -> Calibration:
        """The calibration in a YAML or JSON file.

        Raises:
            CameraError: naming the file and what is wrong with it.
        """
        try:
            text = Path(path).read_text("utf-8")
            try:
                values = json.loads(text)
            except ValueError:
                # OpenCV begins its files with a directive that is not YAML's.
                documents = yaml.load_all(re.sub(r"^\s*%YAML.*\n(---)?", "", text), _Loader)
                values = next(documents, None)
        except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
            raise CameraError(f"{path}: cannot be read as a camera file: {error}") from error
        if not isinstance(values, dict):
            raise CameraError(f"{path}: no camera file: it has no values by name, such as fx")
        return cls.of(values, str(path))

    @classmethod
    def of(cls, values: object, source: str = "camera") -> Calibration:
        """The calibration in a file's values by name, a ROS CameraInfo message or RealSense's
        intrinsics.

        Raises:
            CameraError: naming the `source` and what is wrong with it.
        """
        if not isinstance(values, Mapping):
            public = [name for name in dir(values) if not name.startswith("_")]
            values = {name: getattr(values, name) for name in public}
        try:
            return _calibration(_flat(values), source)
        except CameraError as error:
            raise CameraError(f"{source}: {error}") from error

    def scaled(self, width: int, height: int) -> Calibration:
        """The same of images of another size in the same proportions.

        Raises:
            CameraError: other proportions; or no size known, and a centre unlike that size's.
        """
        if min(width, height) < 1:
            raise CameraError(f"{self.source}: an image has pixels, got {width}x{height}")
        if self.size is None:
            off = np.abs(np.array(self.centre) / (width, height) - 0.5)
            if off.max() > 0.25:
                raise CameraError(
                    f"{self.source}: does not say for which images it is, and with its principal "
                    f"point {self.centre} not for {width}x{height} pixels: add width and height"
                )
            return replace(self, size=(width, height))
        share = width / self.size[0]
        if abs(height / self.size[1] / share - 1) > 0.01:
            raise CameraError(
                f"{self.source}: the image is {width}x{height} pixels, but the calibration is of "
                f"{self.size[0]}x{self.size[1]}, in other proportions: give the whole image, "
                "uncropped, or the calibration of this one"
            )
        return replace(
            self,
            size=(width, height),
            focal=(self.focal[0] * share, self.focal[1] * share),
            centre=((self.centre[0] + 0.5) * share - 0.5, (self.centre[1] + 0.5) * share - 0.5),
        )

    def at(self, pose: NDArray) -> Camera:
        """The camera without its distortion at a pose (4, 4), world from camera.

        Raises:
            CameraError: no size, or a pose that is none.
        """
        if self.size is None:
            raise CameraError(f"{self.source}: lacks width and height")
        try:
            return Camera(*self.size, *self.focal, *self.centre, pose[:3, 3], pose[:3, :3])
        except CameraError as error:
            raise CameraError(f"{self.source}: {error}") from error

    def camera(self) -> Camera:
        """The camera at its pose, above a table at z = 0.

        Raises:
            CameraError: distortion, not one pose, or one whose z points down or is far away.
        """
        if self.distortion.size:
            raise CameraError(
                f"{self.source}: has distortion: undistort the images, and leave its coefficients "
                "out of the file"
            )
        if not self.poses:
            raise CameraError(f"{self.source}: has no pose: add its position and rotation")
        if len(self.poses) > 1:
            raise CameraError(
                f"{self.source}: a quaternion of four numbers may be x, y, z, w or w, x, y, z: "
                "name them, as in {x: 1, y: 0, z: 0, w: 0}"
            )
        camera = self.at(self.poses[0])
        if (far := float(np.linalg.norm(camera.position))) > FARTHEST:
            raise CameraError(
                f"{self.source}: by its pose the camera is {far:.3g} m from the origin; is its "
                "position in millimetres? Divide it by 1000"
            )
        if camera.position[2] <= 0 or camera.rays()[camera.height // 2, camera.width // 2, 2] >= 0:
            raise CameraError(
                f"{self.source}: by its pose the camera does not look down on the table, z = 0, "
                "from above it; z is up, and the camera's axes are OpenCV's"
            )
        return camera

    def undistorted(self, pixels: NDArray, nearest: bool = False) -> NDArray:
        """An image (H, W, ...) as a camera without distortion takes it; what it did not see is NaN,
        or as at the border. Values are interpolated, or those of the `nearest` pixel."""
        height, width = pixels.shape[:2]
        v, u = np.indices((height, width), np.float64)
        seen = np.stack([u, v], axis=-1)
        places = self._distort((seen - self.centre) / self.focal) * self.focal + self.centre
        outside = np.nan if pixels.dtype.kind == "f" else None
        return interpolated(pixels, places, 0 if nearest else 1, outside)

    def _distort(self, places: Floats) -> Floats:
        """Where (..., 2) what is at `places` (..., 2), x / z and y / z, is seen."""
        if self.model == "fisheye":
            k = np.r_[1.0, self.distortion, np.zeros(4)][:5]
            away = np.linalg.norm(places, axis=-1, keepdims=True)
            angle = np.arctan(away)
            bent = angle * np.polynomial.polynomial.polyval(angle**2, k)
            return places * np.where(away > 1e-9, bent / np.maximum(away, 1e-9), 1.0)
        if self.model != "inverse":
            return _brown(places, self.distortion)
        found = places
        for _ in range(_ROUNDS):
            found = found + places - _brown(found, self.distortion)
        return found


class _Loader(yaml.SafeLoader):
    """Knows OpenCV's matrices."""


_Loader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, True)
)


def _brown(places: Floats, coefficients: Floats) -> Floats:
    """Brown and Conrady's distortion of places (..., 2), with OpenCV's coefficients."""
    k1, k2, p1, p2, k3, k4, k5, k6, *s = np.r_[coefficients, np.zeros(12)][:12]
    x, y = np.moveaxis(places, -1, 0)
    r = x**2 + y**2
    radial = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)))
    across = 2 * p1 * x * y + p2 * (r + 2 * x**2) + s[0] * r + s[1] * r**2
    down = p1 * (r + 2 * y**2) + 2 * p2 * x * y + s[2] * r + s[3] * r**2
    return np.stack([x * radial + across, y * radial + down], axis=-1)


def _plain(name: object) -> str:
    return re.sub("[^a-z0-9]", "", str(name).lower())


def _flat(values: Mapping[Any, Any]) -> dict[str, Any]:
    """Values by their names in lower case without punctuation, those of sections too."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = _plain(key)
        if name == "roi":
            found[name] = value
        elif name in _SECTIONS and isinstance(value, Mapping):
            found = _flat(value) | found
        elif value is not None:
            found[name] = value
    return found


def _calibration(values: Mapping[str, Any], source: str) -> Calibration:
    names = (("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy"))
    lens = [_first(values, options) for options in names]
    if (matrix := _first(values, _MATRIX)) is not None:
        k = _numbers(matrix, "the camera matrix")
        if k.size == 9:
            k = k.reshape(3, 3)
            k = k.T if k[2, :2].any() else k  # Open3D writes columns
            k = k[[0, 1, 0, 1], [0, 1, 2, 2]]
        if k.shape != (4,):
            raise CameraError(f"a camera matrix has 9 numbers, got {k.size}")
        lens = [*k]
    if missing := [options[0] for options, one in zip(names, lens, strict=True) if one is None]:
        raise CameraError(
            f"lacks {', '.join(missing)}; a camera file has fx, fy, cx and cy, or a camera matrix "
            "(camera_matrix, intrinsic_matrix, K)"
        )
    sides = [_first(values, (f"image{name}", name)) for name in ("width", "height")]
    if "resolution" in values:
        sides = list(_numbers(values["resolution"], "the resolution", 2))
    if "roi" in values and _is_cropped(values["roi"], sides):
        raise CameraError("is of a region of the image (roi): give the one of the whole image")
    if (sides[0] is None) != (sides[1] is None):
        raise CameraError(f"lacks {'width' if sides[0] is None else 'height'}")
    width, height = (1, 1) if sides[0] is None else sides
    fx, fy, cx, cy = lens
    checked = Camera(width, height, fx, fy, cx, cy, np.zeros(3), np.eye(3))
    focal, centre = (checked.fx, checked.fy), (checked.cx, checked.cy)
    size = None if sides[0] is None else (checked.width, checked.height)
    unit = None
    if (scale := _first(values, ("depthscale", "depthunit", "depthunits"))) is not None:
        unit = _one(scale, "depth_scale")
        if not 0 < unit < 1e9:
            raise CameraError(f"depth_scale is positive, got {unit}")
        unit = 1 / unit if unit > 1 else unit  # Open3D says how many are a metre
    return Calibration(focal, centre, size, *_distortion(values), _poses(values), unit, source)


def _distortion(values: Mapping[str, Any]) -> tuple[Floats, str]:
    told = _first(values, ("distortionmodel", "model", "cameramodel")) or ""
    if isinstance(told, int) and 0 <= told < len(_REALSENSE):
        told = _REALSENSE[told]
    word = re.sub("rs2distortion|distortion", "", _plain(told))
    given = _first(values, _DISTORTION)
    if given is None:
        names = ("k1", "k2", "k3", "k4") if word in _FISHEYE else _COEFFICIENTS
        given = [values.get(one, 0) for one in names]
    coefficients = _numbers(given, "distortion")
    if not coefficients.any():
        return np.zeros(0), ""
    if word == "inversebrownconrady":
        return coefficients, "inverse"
    if word in _FISHEYE:
        return coefficients[:4], "fisheye"
    if word not in _BROWN or coefficients[12:].any():
        raise CameraError(
            f"images of the distortion model {told} with {coefficients.size} coefficients cannot "
            "be undistorted: undistort them before, and leave the coefficients out of the file"
        )
    return coefficients[:12], ""


def _poses(values: Mapping[str, Any]) -> tuple[Floats, ...]:
    """World from camera (4, 4), for each order in which a quaternion may be."""
    if (inverse := _first(values, _CAMERA_FROM_WORLD)) is not None:
        parts = _poses(_flat(inverse)) if isinstance(inverse, Mapping) else (_matrix(inverse),)
        found = tuple(inverted(one) for one in parts)
    elif (matrix := _first(values, _WORLD_FROM_CAMERA)) is not None:
        found = (_matrix(matrix),)
    elif "rvec" in values and "tvec" in values:
        turn = Rotation.from_rotvec(_numbers(values["rvec"], "rvec", 3)).as_matrix()
        found = (inverted(_rigid(turn, _numbers(values["tvec"], "tvec", 3))),)
    else:
        position, rotation = _first(values, _POSITION), _first(values, _ROTATION)
        if position is None and rotation is None:
            return ()
        if position is None or rotation is None:
            lacking = "position" if position is None else "rotation"
            raise CameraError(
                f"lacks {lacking}; a pose has position and rotation, and without either the table "
                "is found in the depth image"
            )
        at = floats(_listed(position, "xyz"), "a camera's position", CameraError)
        found = tuple(_rigid(turn, at) for turn in _rotations(rotation))
    # An identity is what programs write that know no pose, whatever the quaternion's order.
    return () if any(np.allclose(one, np.eye(4)) for one in found) else found


def _rotations(value: Any) -> list[Floats]:
    by_name = isinstance(value, Mapping) and "w" in value
    numbers = floats(_listed(value, "xyzw" if by_name else ""), "a camera's rotation", CameraError)
    if numbers.size != 4:
        return [numbers.reshape(3, 3) if numbers.size == 9 else numbers]
    if not 0.9 < np.linalg.norm(numbers) < 1.1:
        raise CameraError(f"a quaternion has length 1, got {numbers.tolist()}")
    orders = [numbers] if by_name else [numbers, np.roll(numbers, -1)]
    return [Rotation.from_quat(one).as_matrix() for one in orders]


def _matrix(value: Any) -> Floats:
    """A pose (4, 4) written in rows, without the last one perhaps, or in columns."""
    numbers = _numbers(value, "a pose")
    if numbers.size == 12:
        numbers = np.r_[numbers, 0.0, 0.0, 0.0, 1.0]
    if numbers.size != 16:
        raise CameraError(f"a pose is a matrix of 16 numbers, got {numbers.size}")
    matrix = numbers.reshape(4, 4)
    return matrix.T if matrix[3, :3].any() else matrix


def _rigid(rotation: Floats, position: Floats) -> Floats:
    if rotation.shape != (3, 3) or position.shape != (3,):
        name, got = ("rotation", rotation) if position.shape == (3,) else ("position", position)
        shape = "(3,)" if name == "position" else "(3, 3), or is a quaternion w, x, y, z"
        raise CameraError(f"a camera's {name} has shape {shape}, got {got.tolist()}")
    return np.block([[rotation, position[:, None]], [np.array([0.0, 0.0, 0.0, 1.0])]])


def inverted(pose: Floats) -> Floats:
    """The inverse of a pose (4, 4)."""
    turn = pose[:3, :3].T
    return _rigid(turn, -turn @ pose[:3, 3])


def _first(values: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return next((values[name] for name in names if values.get(name) is not None), None)


def _is_cropped(region: Any, sides: list[Any]) -> bool:
    """Whether a CameraInfo's roi is a part of the image; of size 0 it is all of it."""
    if any(_attribute(region, one) for one in ("x_offset", "y_offset")):
        return True
    sizes = [_attribute(region, one) for one in ("width", "height")]
    return any(size and size != side for size, side in zip(sizes, sides, strict=True))


def _attribute(value: Any, name: str) -> Any:
    return value.get(name) if isinstance(value, Mapping) else getattr(value, name, None)


def _listed(value: Any, names: str) -> Any:
    """A matrix's data, or the values of a mapping by these names."""
    if not isinstance(value, Mapping):
        return value
    if "data" in value:
        return value["data"]
    return [value.get(name) for name in names]


def _numbers(value: Any, what: str, size: int | None = None) -> Floats:
    found = np.ravel(floats(_listed(value, "xyz"), what, CameraError))
    if not np.isfinite(found).all() or (size is not None and found.size != size):
        raise CameraError(f"{what} has {size or 'finite'} numbers, got {found.tolist()}")
    return found


def _one(value: Any, what: str) -> float:
    found = floats(value, what, CameraError)
    if found.shape != ():
        raise CameraError(f"{what} is one number, got {found.tolist()}")
    return float(found)
