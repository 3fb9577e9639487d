"""A photograph's file to a rope's: `see` without depth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.calibration import Calibration
from knotflow.perception.camera.image import ImageError, read_colour
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.photo.colours import Colours
from knotflow.perception.photo.estimate import PhotoEstimate, estimate_photo

Floats = NDArray[np.float64]


def see_photo(
    path: Path,
    camera: Camera | Calibration | None = None,
    colours: tuple[str | None, str | None] = (None, None),
) -> tuple[PhotoEstimate, NDArray[np.uint8]]:
    """The rope in a photograph's file, and the photograph (H, W, 3), undistorted by a calibration.

    `colours` are the rope's and its head's, names or #rrggbb.

    Raises:
        ImageError: no image, no rope in it, or no colour.
    """
    rgb = read_colour(path, upright=camera is None)
    if isinstance(camera, Calibration) and camera.distortion.size:
        rgb = camera.scaled(rgb.shape[1], rgb.shape[0]).undistorted(rgb)
    try:
        return estimate_photo(rgb, Colours.parse(*colours)), rgb
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from error


def on_table(found: PhotoEstimate, length: float | None, camera: Camera | None) -> Floats:
    """The centre line (N, 2), metres, x right and y up: scaled to the rope's `length`, metres, else
    where the rays of a `camera` with a pose meet the table, z = 0.

    Raises:
        ImageError: neither is known.
    """
    if length is not None:
        scaled = found.pixels * (length / found.length) * [1.0, -1.0]
        return np.asarray(scaled - (scaled.min(0) + scaled.max(0)) / 2)
    if camera is None:
        raise ImageError(
            "a photograph has no scale: give the rope's --length, or --camera FILE with its pose"
        )
    far = camera.unproject(found.pixels, np.ones(len(found.pixels)))
    down = far - camera.position
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
    state = "unknown" if found.state is None else str(found.state)
    lines = [f"state     {state}" + (" (in doubt)" if found.doubts and found.state else "")]
    lines += [
        f"crossing  {number}: {one.describe()}" for number, one in enumerate(found.crossings, 1)
    ]
    size = f"{found.length:.0f} pixels long, {found.width:.1f} wide"
    lines += [
        "head      "
        + (
            "by its colour"
            if found.head_known
            else "not known (--head-color tells); it is taken to be the left one"
        ),
        "size      " + (f"{metres:.3g} m: {size}" if metres else f"{size}; no scale"),
        *(f"in doubt  {reason}" for reason in found.doubts),
    ]
    return "\n".join(lines)


def draw_photo(path: Path, rgb: NDArray[np.uint8], found: PhotoEstimate) -> None:
    """Write a picture: the photograph, and beside it with the estimate on it."""
    from matplotlib.figure import Figure

    from knotflow.viz.rope import draw_rope
    from knotflow.viz.style import PNG_DPI, WIDTH, styled

    height, width = rgb.shape[:2]
    with styled():
        figure = Figure((WIDTH, 0.5 * WIDTH * height / width + 0.3), layout="constrained")
        bare, drawn = figure.subplots(1, 2)
        for axes in (bare, drawn):
            axes.imshow(rgb)
            axes.set_axis_off()
        lifted = np.column_stack([found.pixels, found.over])
        draw_rope(drawn, lifted, 0.6 * found.width, zorder=3)
        drawn.set_xlim(-0.5, width - 0.5)
        drawn.set_ylim(height - 0.5, -0.5)
        bare.set_title("image")
        reservation = " (in doubt)" if found.doubts else ""
        drawn.set_title(f"estimate: {found.state or 'state unknown'}{reservation}")
        figure.savefig(path, dpi=PNG_DPI)
