"""Pictures of one execution: what a camera saw, with the rope wanted and followed (Fig. 1)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from knotflow.execution.execute import Execution
from knotflow.execution.robot import Relay, Robot
from knotflow.execution.twin import Twin
from knotflow.viz.palette import INK
from knotflow.viz.style import PNG_DPI, WIDTH, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from knotflow.perception import Camera, RgbdImage

EVERY = 2
"""Of so many images one is kept: they would be most of a recording, and its limit is 1 MB."""
QUALITY = 60
"""Of the images' JPEG files."""
WANTED, FOLLOWED = "#ffd33d", "#ffffff"
"""Colours of the rope as it was wanted and as it was followed; dark edges set them off from tables
of any colour."""
_MARGIN = 0.15  # of what is shown, around the ropes
_SIZE, _COLOURS = (320, 240), 64  # pixels and palette of the animation

_Box = tuple[float, float, float, float]  # left, top, right and bottom, pixels


class Filming(Relay):
    """A robot whose images are kept.

    Attributes:
        images: all that were asked for, in order.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self.images: list[RgbdImage] = []

    def observe(self) -> RgbdImage:
        """See `Robot`."""
        self.images.append(super().observe())
        return self.images[-1]


@dataclass(frozen=True, eq=False)
class Frame:
    """A moment of a drag.

    Attributes:
        number: of the robot's moves before.
        step: of the actions before.
        image: what the camera saw.
    """

    number: int
    step: int
    image: RgbdImage


def frames(execution: Execution, twin: Twin, images: Sequence[RgbdImage]) -> list[Frame]:
    """Every second moment at which a rope was dragged, followed and seen."""
    seen = {round(image.time, 6): image for image in images}
    dragged = np.isfinite(execution.reference[:, 0, 0]) & np.isfinite(execution.points[:, 0, 0])
    found = [
        Frame(int(number), int(execution.step[number]), image)
        for number in np.flatnonzero(dragged)
        if (image := seen.get(round(twin.times[number], 6))) is not None
    ]
    return found[::EVERY]


def jpeg(image: RgbdImage) -> bytes:
    """The file of an image's colours."""
    file = io.BytesIO()
    Image.fromarray(image.rgb).save(file, "jpeg", quality=QUALITY)
    return file.getvalue()


def draw_execution(
    stem: Path, execution: Execution, camera: Camera, shown: Sequence[Frame], last: RgbdImage
) -> None:
    """Writes stem.png and stem.svg: an image from the middle of each drag, and the last one.

    Only the part of the images around the ropes is drawn.

    Args:
        stem: path without ending.
        execution: what was wanted and followed.
        camera: of the images.
        shown: frames of the drags.
        last: the image of the last look.
    """
    from matplotlib.figure import Figure

    left, top, right, bottom = _window(execution, camera, shown)
    drags = [[one for one in shown if one.step == n] for n in range(len(execution.outcomes))]
    middles = [drag[len(drag) // 2] for drag in drags if drag]
    columns = min(4, len(middles) + 1)
    lines = -(-(len(middles) + 1) // columns)
    with styled():
        figure = Figure((WIDTH, (0.85 * WIDTH / columns + 0.1) * lines), layout="constrained")
        panels = figure.subplots(lines, columns, squeeze=False).ravel()
        for axes in panels:
            axes.set_axis_off()
        for number, (axes, frame) in enumerate(zip(panels, middles, strict=False), 1):
            axes.imshow(frame.image.rgb)
            wanted = camera.project(execution.reference[frame.number])[:, :2].T
            for colour, width in ((INK, 1.8), (WANTED, 0.9)):
                axes.plot(*wanted, color=colour, linewidth=width)
            _draw_followed(axes, camera, execution.points[frame.number])
            axes.set_title(f"{number}.  {execution.outcomes[frame.step].action}")
        axes = panels[len(middles)]
        axes.imshow(last.rgb)
        if execution.sight is not None and execution.sight.points is not None:
            _draw_followed(axes, camera, execution.sight.points)
        axes.set_title("tied" if execution.tied else "stopped")
        for axes in panels:
            axes.set(xlim=(left, right), ylim=(bottom, top))
        figure.savefig(stem.with_suffix(".png"), dpi=PNG_DPI)
        figure.savefig(stem.with_suffix(".svg"), dpi=PNG_DPI, metadata={"Date": None})


def animate_execution(
    path: Path, execution: Execution, camera: Camera, shown: Sequence[Frame]
) -> None:
    """Writes a GIF of the drags: the camera's images, with what is wanted and followed on them."""
    window = _window(execution, camera, shown)
    images = []
    for frame in shown:
        picture = Image.fromarray(frame.image.rgb).resize(_SIZE, box=window)
        canvas = ImageDraw.Draw(picture)
        wanted, followed = (
            _enlarged(camera.project(ropes[frame.number]), window)
            for ropes in (execution.reference, execution.points)
        )
        for colour, width in ((INK, 3), (WANTED, 1)):
            canvas.line(wanted, colour, width, joint="curve")
        for place in followed:
            canvas.circle(place, 2, FOLLOWED, INK)
        images.append(
            picture.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        )
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=100 * EVERY, loop=0, optimize=True
    )


def _window(execution: Execution, camera: Camera, shown: Sequence[Frame]) -> _Box:
    """What is drawn of the images: all ropes of the frames and some space around them, in the
    images' proportions."""
    rows = [frame.number for frame in shown]
    ropes = np.concatenate([execution.reference[rows], execution.points[rows]])
    pixels = camera.project(ropes.reshape(-1, 3))[:, :2]
    size = np.array([camera.width, camera.height])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    half = size * min(0.5, (0.5 + _MARGIN) * float(((high - low) / size).max()))
    middle = np.clip((low + high) / 2, half, size - half)
    return (*(middle - half).tolist(), *(middle + half).tolist())


def _enlarged(pixels: NDArray[np.float64], window: _Box) -> list[tuple[float, float]]:
    """Where pixels (V, at least 2) of an image are in the animation, whose size the window has."""
    low, high = np.reshape(window, (2, 2))
    return [(u, v) for u, v in ((pixels[:, :2] - low) * _SIZE / (high - low)).tolist()]


def _draw_followed(axes: Axes, camera: Camera, points: NDArray[np.float64]) -> None:
    """A rope (V, 3) in a panel, as dots between which it is seen."""
    pixels = camera.project(points)[:, :2].T
    axes.plot(*pixels, "o", markersize=2.2, color=FOLLOWED, mec=INK, mew=0.4)
