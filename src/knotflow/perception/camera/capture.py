"""An image from its files: registered and undistorted, depth in metres, with the camera's pose."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.calibration import Calibration, inverted
from knotflow.perception.camera.image import (
    FARTHEST,
    ImageError,
    RgbdImage,
    conventional_unit,
    read_colour,
    read_depth,
)
from knotflow.perception.camera.pinhole import Camera, CameraError
from knotflow.perception.camera.table import SeenTable, find_table
from knotflow.topology.polyline import Floats

_UNITS = (1.0, 1e-3, 2.5e-4, 2e-4, 1e-4)  # metres, of depth images of cameras and data sets
_SAME_UNIT = 0.1  # relative difference of distances by pose and by depth
_REACH = (0.05, FARTHEST)  # metres, in which a table is
_LEAST_TABLE, _LEAST_DEPTH = 0.3, 0.05  # of an image
_GRAZING = 0.17  # sine of the angle between the table and the line of sight
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
_BODY = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_MISREADINGS = {
    "": lambda pose: pose,
    "its inverse": inverted,
    "a camera that looks along -z with y up (OpenGL), so negate the rotation's second and third "
    "columns,": lambda pose: pose @ _FLIP,
    "a camera that looks along x with z up (ROS), so give the pose of its optical frame,": (
        lambda pose: pose @ _BODY
    ),
}
"""Other meanings of a pose (4, 4)."""


@dataclass(frozen=True, eq=False)
class Capture:
    """An image and its camera; `notes` say what was assumed and converted."""

    image: RgbdImage
    camera: Camera
    notes: tuple[str, ...]
    unit_assumed: bool = False
    """Whether the unit of depth is what is usual, and nothing confirms it."""


def read_capture(
    rgb: Path | str,
    depth: Path | str,
    calibration: Calibration | Path | str,
    depth_unit: float | None = None,
) -> Capture:
    """The image in a colour and a depth file.

    Depth of another size is registered by scaling, lens distortion is taken out. The unit of depth,
    metres, is `depth_unit`, else the calibration's, else the one with which the pose puts the table
    at z = 0, else the usual one. Without a pose it follows from the table, the plane that fills
    most of the depth image: x is the image's right, the origin the table in its middle.

    Raises:
        CameraError: a calibration of other images, or a pose with which the table is not at z = 0.
        ImageError: files that are no image, are not registered, or whose unit is not known.
    """
    if not isinstance(calibration, Calibration):
        calibration = Calibration.load(calibration)
    colour, raw, notes = read_colour(Path(rgb)), read_depth(Path(depth)), []
    height, width = colour.shape[:2]
    if raw.shape != (height, width):
        raw = _registered(raw, width, height, f"{rgb}, {depth}")
        notes.append(f"depth is scaled to {width}x{height} pixels; it must be the colour's view")
    calibrated, calibration = calibration.size, calibration.scaled(width, height)
    if calibrated not in (None, calibration.size):
        notes.append(f"the calibration is scaled to {width}x{height} pixels")
    if calibration.distortion.size:
        colour, raw = calibration.undistorted(colour), calibration.undistorted(raw, nearest=True)
        notes.append("lens distortion is taken out by the file's coefficients")
    if not np.isfinite(raw).any():
        raise ImageError(f"{depth}: no pixel has a depth: all are NaN, or 0 in the file")
    unit, how = calibration.depth_unit if depth_unit is None else depth_unit, "as given"
    if unit is not None and not 0 < unit < np.inf:
        raise ImageError(f"{depth}: a unit of depth is positive, in metres, got {unit}")
    if unit is None:
        unit, how = _unit_by_pose(raw, calibration), "by the pose"
    assumed = unit is None
    if unit is None:
        unit, how = conventional_unit(raw, depth), "the usual unit; --depth-unit is another"
    metres = (unit * raw).astype(np.float32)
    far = float(np.nanmedian(unit * raw))
    if not _REACH[0] < far < _REACH[1]:
        raise ImageError(
            f"{depth}: with units of {1e3 * unit:g} mm ({how}) most of it is {far:.3g} m away, but "
            f"a table is {_REACH[0]:g} to {_REACH[1]:g} m away; --depth-unit is another"
        )
    find = _posed if calibration.poses else _above_table
    camera, told = find(metres, calibration, depth)
    name = {1.0: "metres", 1e-3: "millimetres"}.get(unit, f"units of {1e3 * unit:g} mm")
    notes = [f"depth is in {name}, {how}", *notes, *told]
    return Capture(RgbdImage(colour, metres), camera, tuple(notes), assumed)


def _registered(raw: Floats, width: int, height: int, files: str) -> Floats:
    """Depth (H, W) at the pixels of a colour image of the same view and proportions."""
    rows, columns = raw.shape
    if abs(columns / width / (rows / height) - 1) > 0.01:
        raise ImageError(
            f"{files}: colour is {width}x{height} pixels but depth {columns}x{rows}, in other "
            "proportions, so they are not of the same view: record depth aligned to colour "
            "(RealSense: rs.align; ROS: aligned_depth_to_color or depth_registered)"
        )
    v = ((np.arange(height) + 0.5) * rows / height).astype(int)
    u = ((np.arange(width) + 0.5) * columns / width).astype(int)
    return raw[np.ix_(v, u)]


def _unit_by_pose(raw: Floats, calibration: Calibration) -> float | None:
    """The unit of depth (H, W), metres, with which most of it is as far as z = 0 by a pose; None
    where no usual unit or pose does."""
    for pose in calibration.poses:
        camera = calibration.at(_upright(pose))
        down = camera.points(np.ones(raw.shape))[..., 2] - camera.position[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            far = np.where(down < 0, -camera.position[2] / down, np.nan)
            share = np.nanmedian(far / raw) if np.isfinite(far).any() else np.nan
        for unit in _UNITS:
            reached = unit * float(np.nanmedian(raw))
            if abs(unit - share) < _SAME_UNIT * share and _REACH[0] < reached < _REACH[1]:
                return unit
    return None


def _posed(
    metres: NDArray, calibration: Calibration, depth: Path | str
) -> tuple[Camera, list[str]]:
    """The camera whose pose puts the table of a depth image (H, W), metres, at z = 0."""
    fitting = [one for one in calibration.poses if _fits(metres, calibration, one)]
    if not fitting:
        raise CameraError(f"{calibration.source}: {_misfit(metres, calibration, depth)}")
    if len(fitting) > 1:
        raise CameraError(
            f"{calibration.source}: a quaternion of four numbers may be x, y, z, w or w, x, y, z, "
            "and the table tells neither from the other: name them, as in {x: 1, y: 0, z: 0, w: 0}"
        )
    told = []
    if len(calibration.poses) > 1:
        order = "x, y, z, w" if fitting[0] is calibration.poses[0] else "w, x, y, z"
        told.append(f"the quaternion is {order}: the other order puts no table at z = 0")
    if fitting[0][2, 3] < 0:
        told.append("the pose's z points down: y and z are reversed")
    camera = calibration.at(_upright(fitting[0]))
    table = SeenTable.of(metres, camera)
    seated = table.seated(camera)
    if seated is not camera:
        told.append(f"with the file's pose the table lies {table}: the pose is corrected by that")
    return seated, told


def _misfit(metres: NDArray, calibration: Calibration, depth: Path | str) -> str:
    """How far off the table a pose is, and what would be right."""
    pose = calibration.poses[0]
    table = SeenTable.of(metres, calibration.at(_upright(pose)))
    fitting: dict[str, bool] = {}  # and whether its z points up
    for (what, read), scale in itertools.product(_MISREADINGS.items(), (1.0, 1e-3)):
        other = np.array(pose)
        other[:3, 3] *= scale
        if _fits(metres, calibration, read(other)):
            means = [what] if what else []
            means += ["a position in millimetres, so divided by 1000,"] if scale != 1 else []
            cure = f"{' and '.join(means)} fits"
            if read is inverted:
                cure += " (`pose` is world from camera, `extrinsic` camera from world)"
            fitting[cure] = bool(read(other)[2, 3] > 0)
    likely = [one for one, up in fitting.items() if up] or [*fitting]
    cure = "; or ".join(likely) or (
        "without a pose in the file, the table is found in the depth image"
    )
    return (
        f"with this pose most of {depth} lies {table.offset:+.2f} m above z = 0, tilted by "
        f"{np.rad2deg(table.tilt):.0f} degrees, but most of an image is the table, at z = 0; {cure}"
    )


def _fits(metres: NDArray, calibration: Calibration, pose: Floats) -> bool:
    """Whether a pose (4, 4) puts the table of a depth image (H, W), metres, below it, at z = 0."""
    camera = calibration.at(_upright(pose))
    middle = camera.rays()[camera.height // 2, camera.width // 2]
    return SeenTable.of(metres, camera).fits and bool(middle[2] < 0)


def _upright(pose: Floats) -> Floats:
    """A pose (4, 4) in a world whose z points up: the camera is above the table."""
    return _FLIP @ pose if pose[2, 3] < 0 else pose


def _above_table(
    metres: NDArray, calibration: Calibration, depth: Path | str
) -> tuple[Camera, list[str]]:
    """The camera above the table that is found in a depth image (H, W), metres."""
    known = float(np.isfinite(metres).mean())
    if known < _LEAST_DEPTH:
        raise ImageError(
            f"{depth}: no table is found: {known:.1%} of its pixels have a depth; at least "
            f"{_LEAST_DEPTH:.0%} are needed, or the camera's pose in its file"
        )
    pose, share, rms = find_table(metres, calibration)
    camera = calibration.at(pose)
    slope = -float(camera.rays()[camera.height // 2, camera.width // 2, 2])
    if share < _LEAST_TABLE or slope < _GRAZING:
        raise ImageError(
            f"{depth}: no table is found: the largest plane is {share:.0%} of the image, "
            f"seen at {np.rad2deg(np.arcsin(slope)):.0f} degrees; let the table fill most of it, "
            "or add the camera's pose to its file (position and rotation, the table at z = 0)"
        )
    return camera, [
        f"the table is found in the depth image, {share:.0%} of it with "
        f"{1e3 * rms:.1f} mm rms: the camera is {camera.position[2]:.3f} m above it, and "
        f"looks {90 - np.rad2deg(np.arcsin(slope)):.1f} degrees off straight down; x is to the "
        "image's right, the origin on the table in the image's middle"
    ]
