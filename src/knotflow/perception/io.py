"""From the files of an image to a rope's file, and pictures of estimates: the `see` command."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from knotflow.perception.camera.calibration import Calibration
from knotflow.perception.camera.capture import Capture, read_capture
from knotflow.perception.camera.image import ImageError, RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.estimate import RopeEstimate, estimate
from knotflow.perception.estimation.segmentation import segment
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.photo.colours import Colours
from knotflow.perception.photo.io import beside, describe_state
from knotflow.simulation import RopeConfig
from knotflow.viz.rope import draw_rope
from knotflow.viz.style import BAD

_CLUTTER = 4.0  # times the rope's area, that stands above a table whose depth has the right unit


def see(
    rgb: Path,
    depth: Path,
    camera: Path | Calibration,
    rope: RopeConfig | None = None,
    depth_unit: float | None = None,
    colours: tuple[str | None, str | None] = (None, None),
    max_seconds: float = np.inf,
) -> tuple[RopeEstimate, Capture]:
    """The rope in the files of an image, and what was read to find it, see `read_capture`; a
    terminal shows progress. Without a `rope` it is the default one. `colours` are the rope's and
    its head's, names or #rrggbb; `max_seconds` ends the search with the best so far.

    Raises:
        CameraError: a camera file that cannot be used, or whose pose is far off the table.
        ImageError: files that make no image of that camera, or in which no rope is seen.
    """
    rope = rope or RopeConfig()
    seen = read_capture(rgb, depth, camera, depth_unit)
    if seen.unit_assumed:
        _check_unit(seen, rope, depth)
    try:
        with tqdm(desc="looking", unit=" shapes", leave=False, disable=None) as bar:
            deadline = time.monotonic() + max_seconds

            def progress() -> bool:
                bar.update()
                return time.monotonic() < deadline

            known = Colours.parse(*colours)
            found = estimate(seen.image, seen.camera, rope, progress=progress, colours=known)
            return found, seen
    except TraceError as error:
        raise ImageError(
            f"{rgb}, {depth}: no rope of {rope.length:g} m by {2e3 * rope.radius:g} mm is seen "
            f"above the table: {error}"
        ) from error


def _check_unit(seen: Capture, rope: RopeConfig, depth: Path) -> None:
    """Raises `ImageError` where far more than a rope stands above the table, as in a wrong unit."""
    mask = segment(seen.image, seen.camera, rope.radius).rope
    away = seen.image.depth[mask]
    area = float(np.nansum(away**2)) / (seen.camera.fx * seen.camera.fy)
    share = area / (2 * rope.radius * rope.length)
    if share > _CLUTTER:
        raise ImageError(
            f"{depth}: what is seen above the table is {share:.0f} times as large as a rope of "
            f"{rope.length:g} m by {2e3 * rope.radius:g} mm: is it another rope (--length, "
            "--diameter), or depth in another unit (--depth-unit 0.25mm)? --depth-unit mm (or m) "
            "if neither"
        )


def describe(found: RopeEstimate, seen: Capture | None = None) -> str:
    """What was made of the files, state, crossings with their certainty, ambiguities, in lines."""
    lines = [f"input     {note}" for note in (seen.notes if seen else ())]
    lines += describe_state(found.state, found.crossings, found.ambiguous)
    ends = (
        "by its colour" if found.head_known else "not known: neither end stands out (--head-color)"
    )
    lines += [
        f"head      {ends}",
        f"seen      {found.visible.mean():.0%} of the vertices",
        f"image     the shape accounts for {found.coverage_fraction:.0%} of the rope in it",
    ]
    lines += [f"in doubt  {reason}" for reason in found.all_ambiguities]
    return "\n".join(lines)


def write_rope(path: Path, points: NDArray) -> None:
    """Write a rope (V, 3), metres, as a CSV file that plans start from."""
    np.savetxt(path, points, fmt="%.6f", delimiter=",", header="x_m,y_m,z_m", comments="")


def draw_overlay(
    path: Path, image: RgbdImage, camera: Camera, rope: RopeConfig, found: RopeEstimate
) -> None:
    """Write a picture: the image, and beside it where the rope is, with the estimate on it; hidden
    vertices are ringed."""
    pixels, hidden = camera.project(found.points), ~found.visible
    column, row, depth = pixels.T
    width = 2 * rope.radius * camera.fx / float(np.median(depth))
    size = np.array([camera.width, camera.height])
    low, high = pixels[:, :2].min(axis=0), pixels[:, :2].max(axis=0)
    half = size / 2 * min(1.0, float(((high - low + 24) / size).max()))  # of what is shown
    middle = np.clip((low + high) / 2, half - 0.5, size - half - 0.5)
    with beside(path, image.rgb, found.state, found.ambiguous) as axes:
        # The nearest strand is on top, as heights are in a drawing, thinner than it is.
        draw_rope(axes, np.stack([column, row, depth.max() - depth], 1), 0.6 * width, zorder=3)
        axes.scatter(column[hidden], row[hidden], s=14, facecolors="none", edgecolors=BAD, zorder=4)
        axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
        axes.set_ylim(middle[1] + half[1], middle[1] - half[1])


def arrange_pictures(
    pictures: Sequence[Path], path: Path, columns: int = 2, width: int = 1500
) -> None:
    """Write one picture, `width` pixels wide and of 128 colours, of several of one size, row by
    row."""
    with Image.open(pictures[0]) as first:
        size = width // columns, round(width / columns * first.height / first.width)
    rows = -(-len(pictures) // columns)
    whole = Image.new("RGB", (width, rows * size[1]), "white")
    for number, picture in enumerate(pictures):
        row, column = divmod(number, columns)
        with Image.open(picture) as one:
            whole.paste(one.convert("RGB").resize(size), (column * size[0], row * size[1]))
    whole.quantize(128).save(path, "png")
