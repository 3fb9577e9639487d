"""A photograph's file to a rope's: `see` without depth."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.calibration import Calibration
from knotflow.perception.camera.image import ImageError, is_turned, read_colour
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.crossings import CrossingEvidence
from knotflow.perception.photo.colours import Colours
from knotflow.perception.photo.estimate import PhotoEstimate, estimate_photo
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats
from knotflow.viz.rope import draw_rope
from knotflow.viz.style import PNG_DPI, WIDTH, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NO_SCALE = "a photograph has no scale: give the rope's --length, or --camera FILE with its pose"


def see_photo(
    path: Path,
    camera: Camera | Calibration | None = None,
    colours: tuple[str | None, str | None] = (None, None),
) -> tuple[PhotoEstimate, NDArray[np.uint8]]:
    """The rope in a photograph's file, and the photograph (H, W, 3), undistorted by a calibration.

    `colours` are the rope's and its head's, names or #rrggbb.

    Raises:
        ImageError: no image, no rope in it, no colour, or with a camera an image that is shown
            turned.
    """
    if camera is not None and is_turned(path):
        raise ImageError(
            f"{path}: is shown in another direction than it is stored in (EXIF), and the camera "
            "file does not say which it means: save it again in that direction, without the tag"
        )
    rgb = read_colour(path, upright=camera is None)
    if isinstance(camera, Calibration) and camera.distortion.size:
        rgb = camera.scaled(rgb.shape[1], rgb.shape[0]).undistorted(rgb)
    try:
        return estimate_photo(rgb, Colours.parse(*colours)), rgb
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from error


def on_table(found: PhotoEstimate, length: float | None, camera: Camera | None) -> Floats:
    """The centre line (N, 2), metres, x right and y up: where the rays of a `camera` with a pose
    meet the table, z = 0, else scaled to the rope's `length`, metres.

    Raises:
        ImageError: neither is known, or the pose does not put the rope on the table.
    """
    if camera is None and length is not None:
        scaled = found.pixels * (length / found.length) * [1.0, -1.0]
        return np.asarray(scaled - (scaled.min(0) + scaled.max(0)) / 2)
    if camera is None:
        raise ImageError(NO_SCALE)
    far = camera.unproject(found.pixels, np.ones(len(found.pixels)))
    down = far - camera.position
    if (down[:, 2] >= 0).any():
        raise ImageError("by the camera's pose a part of the rope is above the horizon")
    reach = -camera.position[2] / down[:, 2:]
    return np.asarray((camera.position + reach * down)[:, :2])


def write_photo_rope(path: Path, xy: Floats, over: Floats) -> None:
    """Write a rope (N, 2), metres, and where it is the upper strand (N,), as a CSV file that plans
    start from."""
    np.savetxt(
        path, np.column_stack([xy, over]), fmt=("%.6f", "%.6f", "%d"), delimiter=",",
        header="x_m,y_m,over", comments="",
    )  # fmt: skip


def describe_photo(found: PhotoEstimate, metres: float | None = None) -> str:
    """State, crossings with their certainty, size and doubts, in lines; `metres` is its length."""
    size = f"{found.length:.0f} pixels long, {found.width:.1f} wide"
    left = "not known (--head-color tells); it is taken to be the left one"
    lines = [
        *describe_state(found.state, found.crossings, bool(found.doubts)),
        f"head      {'by its colour' if found.head_known else left}",
        "size      " + (f"{metres:.3g} m: {size}" if metres else f"{size}; no scale"),
        *(f"in doubt  {reason}" for reason in found.doubts),
    ]
    return "\n".join(lines)


def describe_state(
    state: TopologicalState | None, crossings: tuple[CrossingEvidence, ...], doubtful: bool
) -> list[str]:
    """An estimate's state, and its crossings with their certainty, in lines."""
    told = "unknown" if state is None else f"{state}{' (in doubt)' if doubtful else ''}"
    crossed = (f"crossing  {number}: {one.describe()}" for number, one in enumerate(crossings, 1))
    return [f"state     {told}", *crossed]


def draw_photo(path: Path, rgb: NDArray[np.uint8], found: PhotoEstimate) -> None:
    """Write a picture: the photograph, and beside it with the estimate on it."""
    with beside(path, rgb, found.state, bool(found.doubts)) as axes:
        draw_rope(axes, np.column_stack([found.pixels, found.over]), 0.6 * found.width, zorder=3)


@contextmanager
def beside(
    path: Path,
    rgb: NDArray[np.uint8],
    state: TopologicalState | None,
    doubtful: bool,
) -> Iterator[Axes]:
    """A picture: an image (H, W, 3), and beside it another one, on whose axes an estimate is
    drawn."""
    from matplotlib.figure import Figure

    doubt = " (in doubt)" if doubtful else ""
    titles = "image", f"estimate: {state or 'state unknown'}{doubt}"
    with styled():
        height = 0.5 * WIDTH * rgb.shape[0] / rgb.shape[1] + 0.4
        figure = Figure((WIDTH, height), layout="constrained")
        bare, drawn = figure.subplots(1, 2)
        for axes, title in zip((bare, drawn), titles, strict=True):
            axes.imshow(rgb)
            axes.set_axis_off()
            axes.set_title(title)
        yield drawn
        figure.savefig(path, dpi=PNG_DPI)
