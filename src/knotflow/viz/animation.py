"""A plan as a small animation: the rope seen from above, the gripper moving along each spline."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from knotflow.planning.plan import KnotPlan
from knotflow.simulation import spline_path
from knotflow.viz.palette import INK, MUTED, SPLINE
from knotflow.viz.rope import rope_pieces

_OVERSAMPLING = 2  # drawn larger and scaled down, for smooth edges
_COLOURS = 48  # of the palette; keeps a plan of five steps below 1 MB
_BANDS = 16  # of one colour each along the rope: as many as the palette has room for
_HEADER = 44  # pixels above the view, for text
_HEIGHT = 0.62  # of the view, in its width
_PAUSE = 0.8  # seconds between steps
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
    for number, step in enumerate(plan.steps, start=1):
        if len(step.trajectory) != len(step.times):
            raise ValueError(
                f"step {number} has no trajectory: the plan was saved with trajectories=False"
            )
    frames: list[Image.Image] = []
    seconds: list[float] = []
    for number, (step, controls) in enumerate(zip(plan.steps, plan.controls, strict=True), start=1):
        spline = spline_path(controls, np.linspace(0.0, 1.0, 50))
        view = _View(plan, np.concatenate((step.trajectory.reshape(-1, 3), spline)), width)
        title = f"{number}/{len(plan.steps)}  {step.action}"
        for index, (points, gripper) in enumerate(zip(step.trajectory, step.gripper, strict=True)):
            holds = step.times[index] <= plan.move_time
            frame = view.frame(title, str(step.start_state))
            frame.spline(spline)
            frame.rope(points)
            frame.gripper(gripper, holds)
            frames.append(frame.image())
        seconds += [_PAUSE, *np.diff(step.times)]
    frame = _View(plan, plan.shapes[-1], width).frame(
        "tied" if plan.solved else "search stopped here", str(plan.states[-1])
    )
    frame.rope(plan.shapes[-1])
    frames.append(frame.image())
    seconds.append(2.5)
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
        self.goal, self.radius = plan.goal, plan.radius
        self.shown = (width, round(_HEIGHT * width) + _HEADER)
        room = _OVERSAMPLING * np.array([width, _HEIGHT * width])
        self.scale = float((room / (high - low)).min())  # pixels a metre
        centre = room / 2 + (0, _OVERSAMPLING * _HEADER)
        self._offset = centre - self.scale * (low + high) / 2 * (1, -1)

    def frame(self, title: str, state: str) -> _Frame:
        """An empty table with its texts and a scale bar."""
        return _Frame(self, title, state)

    def pixels(self, places: NDArray) -> list[tuple[float, float]]:
        """Where places (N, 2 or 3) are in the picture before it is scaled down."""
        return [
            (float(x), float(y)) for x, y in places[:, :2] * self.scale * (1, -1) + self._offset
        ]


class _Frame:
    """One picture of the animation."""

    def __init__(self, view: _View, title: str, state: str) -> None:
        self._view = view
        width, height = (_OVERSAMPLING * side for side in view.shown)
        self._image = Image.new("RGB", (width, height), "white")
        self._canvas = ImageDraw.Draw(self._image)
        edge = 10 * _OVERSAMPLING
        small = _font(11 * _OVERSAMPLING)
        self._canvas.text((edge, edge * 0.7), title, fill=INK, font=_font(15 * _OVERSAMPLING))
        self._canvas.text((edge, edge * 2.7), state, fill=MUTED, font=small)
        goal = view.goal if len(view.goal) < 24 else view.goal[:21] + "..."
        self._canvas.text((width - edge, edge * 0.7), goal, fill=MUTED, font=small, anchor="ra")
        end = width - edge
        bar = (end - _BAR * view.scale, edge * 3.2, end, edge * 3.2)
        self._canvas.line(bar, fill=MUTED, width=2 * _OVERSAMPLING)
        self._canvas.text((bar[0] - edge / 2, bar[1]), "10 cm", fill=MUTED, font=small, anchor="rm")

    def image(self) -> Image.Image:
        """The finished picture."""
        return self._image.resize(self._view.shown, Image.Resampling.LANCZOS)

    def rope(self, points: NDArray) -> None:
        """The rope (V, 3), metres."""
        for piece in rope_pieces(points, 2.0 * self._view.radius, _BANDS):
            self._canvas.polygon(self._view.pixels(piece.outline), fill=piece.colour)

    def spline(self, path: NDArray) -> None:
        """The whole path (N, 3) of the gripper as a dashed line, metres."""
        places = self._view.pixels(path)
        for begin, end in zip(places[:-1:2], places[1::2], strict=False):
            self._canvas.line((*begin, *end), fill=SPLINE, width=3)

    def gripper(self, place: NDArray, holds: bool) -> None:
        """The gripper (3,), metres."""
        ((x, y),) = self._view.pixels(place[None])
        ring = (0.014 + 0.12 * float(place[2])) * self._view.scale
        box = (x - ring, y - ring, x + ring, y + ring)
        self._canvas.ellipse(box, outline=SPLINE, width=3 * _OVERSAMPLING)
        if holds:
            dot = 0.007 * self._view.scale
            self._canvas.ellipse((x - dot, y - dot, x + dot, y + dot), fill=SPLINE)


@cache
def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
