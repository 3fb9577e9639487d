"""A plan as a small animation: the rope seen from above, the gripper moving along each spline."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from knotflow.planning.plan import KnotPlan
from knotflow.simulation import spline_path
from knotflow.viz.rope import rope_pieces
from knotflow.viz.style import INK, MUTED, SPLINE

_OVERSAMPLING = 2  # drawn larger and scaled down, for smooth edges
_COLOURS = 48  # of the palette; keeps a plan of five steps below 1 MB
_BANDS = 16  # colours along the rope: as many as the palette has room for
_HEADER = 44  # pixels above the view, for text
_HEIGHT = 0.62  # of the view, in its width
_PAUSE, _END = 0.8, 2.5  # seconds between steps, and of the last picture
_PAD = 0.03  # metres round everything
_BAR = 0.1  # metres


def animate_plan(plan: KnotPlan, path: Path, width: int = 600, speed: float = 1.0) -> None:
    """Write the plan as a GIF that runs in a loop.

    Each step fills the view: the knot is small where the rope was long. The gripper is a filled
    circle while it holds the rope, and larger the higher it is.

    Args:
        plan: with its trajectories.
        path: of the GIF.
        width: pixels.
        speed: 2.0 plays twice as fast as it was simulated.

    Raises:
        ValueError: a plan without steps, or one that was saved without trajectories.
    """
    if not plan.steps:
        raise ValueError("a plan without steps has nothing to animate")
    frames: list[Image.Image] = []
    seconds: list[float] = []
    for number, (step, controls) in enumerate(zip(plan.steps, plan.controls, strict=True), start=1):
        if len(step.trajectory) != len(step.times):
            raise ValueError(
                f"step {number} has no trajectory: the plan was saved with trajectories=False"
            )
        spline = spline_path(controls, np.linspace(0.0, 1.0, 50))
        view = _View(plan, np.concatenate((step.trajectory.reshape(-1, 3), spline)), width)
        texts = f"{number}/{len(plan.steps)}  {step.action}", str(step.start_state)
        for time, points, gripper in zip(step.times, step.trajectory, step.gripper, strict=True):
            frames.append(view.frame(*texts, points, spline, gripper, time <= plan.move_time))
        seconds += [_PAUSE, *np.diff(step.times)]
    title = "tied" if plan.solved else "search stopped here"
    last = plan.shapes[-1]
    frames.append(_View(plan, last, width).frame(title, str(plan.states[-1]), last))
    seconds.append(_END)
    # A GIF counts in hundredths of a second, and viewers slow down what is below two of them.
    milliseconds = [max(20, round(second * 100 / speed) * 10) for second in seconds]
    palette = frames[-2].quantize(_COLOURS, dither=Image.Dither.NONE)
    images = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    images[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=milliseconds,
        loop=0,
        optimize=True,
    )


class _View:
    """The part of the table that holds all given points (N, 3), metres, in pixels."""

    def __init__(self, plan: KnotPlan, points: NDArray, width: int) -> None:
        low, high = points[:, :2].min(axis=0) - _PAD, points[:, :2].max(axis=0) + _PAD
        self._goal = plan.goal if len(plan.goal) < 24 else plan.goal[:21] + "..."
        self._diameter = 2.0 * plan.radius
        self._size = (width, round(_HEIGHT * width) + _HEADER)
        room = _OVERSAMPLING * np.array([width, _HEIGHT * width])
        self._scale = float((room / (high - low)).min())  # pixels a metre
        centre = room / 2 + (0, _OVERSAMPLING * _HEADER)
        self._offset = centre - self._scale * (low + high) / 2 * (1, -1)

    def frame(
        self,
        title: str,
        state: str,
        points: NDArray,
        spline: NDArray | None = None,
        gripper: NDArray | None = None,
        holding: bool = False,
    ) -> Image.Image:
        """One picture: texts, scale bar, rope (V, 3), dashed spline (N, 3) and gripper (3,)."""
        width, height = (_OVERSAMPLING * side for side in self._size)
        image = Image.new("RGB", (width, height), "white")
        canvas = ImageDraw.Draw(image)
        edge, small = 10 * _OVERSAMPLING, _font(11 * _OVERSAMPLING)
        right = width - edge
        canvas.text((edge, edge * 0.7), title, fill=INK, font=_font(15 * _OVERSAMPLING))
        canvas.text((edge, edge * 2.7), state, fill=MUTED, font=small)
        canvas.text((right, edge * 0.7), self._goal, fill=MUTED, font=small, anchor="ra")
        left, y = right - _BAR * self._scale, edge * 3.2
        canvas.line((left, y, right, y), fill=MUTED, width=2 * _OVERSAMPLING)
        canvas.text((left - edge / 2, y), "10 cm", fill=MUTED, font=small, anchor="rm")
        if spline is not None:
            dashes = self._pixels(spline)
            for begin, end in zip(dashes[:-1:2], dashes[1::2], strict=False):
                canvas.line((*begin, *end), fill=SPLINE, width=3)
        for piece in rope_pieces(points, self._diameter, _BANDS):
            canvas.polygon(self._pixels(piece.outline), fill=piece.colour)
        if gripper is not None:
            ((x, y),) = self._pixels(gripper[None])
            ring, dot = (0.014 + 0.12 * float(gripper[2])) * self._scale, 0.007 * self._scale
            box = (x - ring, y - ring, x + ring, y + ring)
            canvas.ellipse(box, outline=SPLINE, width=3 * _OVERSAMPLING)
            if holding:
                canvas.ellipse((x - dot, y - dot, x + dot, y + dot), fill=SPLINE)
        return image.resize(self._size, Image.Resampling.LANCZOS)

    def _pixels(self, places: NDArray) -> list[tuple[float, float]]:
        """Where places (N, 2 or 3) are in the picture before it is scaled down."""
        pixels = places[:, :2] * self._scale * (1, -1) + self._offset
        return [(float(x), float(y)) for x, y in pixels]


@cache
def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
