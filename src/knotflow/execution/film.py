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

from knotflow.drawing.palette import SPLINE
from knotflow.drawing.style import PNG_DPI, WIDTH, styled
from knotflow.execution.execute import Execution
from knotflow.execution.robot import Relay, Robot
from knotflow.execution.twin import Twin

if TYPE_CHECKING:
    from knotflow.perception import Camera, RgbdImage

EVERY = 2
"""Of so many images one is kept: they would be most of a recording, and its limit is 1 MB."""
QUALITY = 60
"""Of the images' JPEG files."""
FOLLOWED = "#ffffff"
"""Colour of the rope as it was followed; what was wanted has that of a plan's splines."""
_SHRUNK, _COLOURS = (240, 180), 48  # pixels and palette of the animation


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

    Args:
        stem: path without ending.
        execution: what was wanted and followed.
        camera: of the images.
        shown: frames of the drags.
        last: the image of the last look.
    """
    from matplotlib.figure import Figure

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
            for points, colour in _ropes(execution, frame):
                axes.plot(*camera.project(points)[:, :2].T, color=colour, linewidth=1.0)
            axes.set_title(f"{number}.  {execution.outcomes[frame.step].action}")
        axes = panels[len(middles)]
        axes.imshow(last.rgb)
        if execution.sight is not None and execution.sight.points is not None:
            axes.plot(*camera.project(execution.sight.points)[:, :2].T, color=FOLLOWED, lw=1.0)
        axes.set_title("tied" if execution.tied else "stopped")
        figure.savefig(stem.with_suffix(".png"), dpi=PNG_DPI)
        figure.savefig(stem.with_suffix(".svg"), dpi=PNG_DPI, metadata={"Date": None})


def animate_execution(
    path: Path, execution: Execution, camera: Camera, shown: Sequence[Frame]
) -> None:
    """Writes a GIF of the drags: the camera's images, with what is wanted and followed on them."""
    images = []
    for frame in shown:
        picture = Image.fromarray(frame.image.rgb)
        canvas = ImageDraw.Draw(picture)
        for points, colour in _ropes(execution, frame):
            canvas.line([(u, v) for u, v, _ in camera.project(points).tolist()], colour, width=1)
        small = picture.resize(_SHRUNK, Image.Resampling.LANCZOS)
        images.append(small.quantize(_COLOURS, dither=Image.Dither.NONE))
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=100 * EVERY, loop=0, optimize=True
    )


def _ropes(execution: Execution, frame: Frame) -> tuple[tuple[NDArray[np.float64], str], ...]:
    """Ropes (V, 3) to be drawn on a frame, and their colours."""
    wanted, followed = execution.reference[frame.number], execution.points[frame.number]
    return (wanted, SPLINE), (followed, FOLLOWED)
