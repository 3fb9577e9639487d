"""A plan as a small animation: the rope seen from above, the gripper moving along each spline."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from knotflow.planning.pictures import INK, MUTED, ROPE_COLOURS, SPLINE
from knotflow.planning.plan import KnotPlan, PlanStep
from knotflow.simulation import spline_path

_OVERSAMPLING = 2  # drawn larger and scaled down, for smooth edges
_COLOURS = 48  # of the palette; keeps a plan of five steps below 1 MB
_HEADER = 44  # pixels above the view, for text
_PAUSE = 0.8  # seconds between steps
_PAD = 0.06  # metres round everything


def animate_plan(plan: KnotPlan, path: Path, width: int = 600, speed: float = 1.0) -> None:
    """Write the plan as a GIF that runs in a loop.

    Strands are drawn in the order of their heights, so what is over is over; the gripper is a
    filled circle while it holds the rope, and larger the higher it is.

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
    view = _View(plan, width)
    frames: list[Image.Image] = []
    seconds: list[float] = []
    for number, step in enumerate(plan.steps, start=1):
        title = f"{number}/{len(plan.steps)}  {step.action}"
        for index, (points, gripper) in enumerate(zip(step.trajectory, step.gripper, strict=True)):
            holds = step.times[index] <= plan.move_time
            frames.append(view.draw(points, step, gripper, holds, title, str(step.start_state)))
        seconds += [_PAUSE, *np.diff(step.times)]
    final = "tied" if plan.solved else "search stopped here"
    frames.append(view.draw(plan.shapes[-1], None, None, False, final, str(plan.states[-1])))
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
    """The table from above in pixels, the same for all frames."""

    def __init__(self, plan: KnotPlan, width: int) -> None:
        everything = np.concatenate(
            [plan.shapes[..., :2].reshape(-1, 2)]
            + [step.gripper[:, :2] for step in plan.steps]
            + [step.trajectory[..., :2].reshape(-1, 2) for step in plan.steps]
        )
        low, high = everything.min(axis=0) - _PAD, everything.max(axis=0) + _PAD
        missing = max(0.0, (high - low)[0] / 2.5 - (high - low)[1])
        low[1], high[1] = low[1] - missing / 2, high[1] + missing / 2
        self.goal, self.radius = plan.goal, plan.radius
        self.controls = dict(zip(map(id, plan.steps), plan.controls, strict=True))
        self.scale = _OVERSAMPLING * width / float((high - low)[0])  # pixels a metre
        self.low, self.high = low, high
        height = round((high - low)[1] * self.scale) + _OVERSAMPLING * _HEADER
        self.size = (_OVERSAMPLING * width, height)
        self.shown = (width, round(height / _OVERSAMPLING))

    def draw(
        self,
        points: NDArray,
        step: PlanStep | None,
        gripper: NDArray | None,
        holds: bool,
        title: str,
        state: str,
    ) -> Image.Image:
        """One frame: rope (V, 3), the step's spline, and the gripper (3,), metres."""
        image = Image.new("RGB", self.size, "white")
        canvas = ImageDraw.Draw(image)
        if step is not None:
            path = spline_path(self.controls[id(step)], np.linspace(0.0, 1.0, 50))
            for piece in range(0, 49, 2):  # every second piece: a dashed line
                ends = [self._pixel(path[piece]), self._pixel(path[piece + 1])]
                canvas.line([place for end in ends for place in end], fill=SPLINE, width=3)
        self._draw_rope(canvas, np.asarray(points, np.float64))
        if gripper is not None:
            self._draw_gripper(canvas, gripper, holds)
        edge = 10 * _OVERSAMPLING
        canvas.text((edge, edge * 0.7), title, fill=INK, font=_font(15 * _OVERSAMPLING))
        canvas.text((edge, edge * 2.7), state, fill=MUTED, font=_font(11 * _OVERSAMPLING))
        goal = self.goal if len(self.goal) < 24 else self.goal[:21] + "..."
        canvas.text(
            (self.size[0] - edge, edge * 0.7),
            goal,
            fill=MUTED,
            font=_font(11 * _OVERSAMPLING),
            anchor="ra",
        )
        return image.resize(self.shown, Image.Resampling.LANCZOS)

    def _draw_rope(self, canvas: ImageDraw.ImageDraw, points: NDArray) -> None:
        """Pieces of the rope from the lowest to the highest, each with a white edge."""
        pieces = 4 * (len(points) - 1)
        at = np.linspace(0, len(points) - 1, pieces + 1)
        dense = np.stack([np.interp(at, np.arange(len(points)), points[:, k]) for k in range(3)], 1)
        height = (dense[1:, 2] + dense[:-1, 2]) / 2
        width = 2.0 * self.radius * self.scale
        colours = _rope_colours(pieces)
        for piece in np.argsort(height, kind="stable"):
            # The edge is drawn under this piece and its neighbours, which are about as high.
            begin, end = self._pixel(dense[piece]), self._pixel(dense[piece + 1])
            canvas.line([*begin, *end], fill="white", width=round(1.5 * width))
            for near in (piece - 1, piece, piece + 1):
                if 0 <= near < pieces:
                    ends = (*self._pixel(dense[near]), *self._pixel(dense[near + 1]))
                    canvas.line(ends, fill=colours[near], width=round(width))
                    self._dot(canvas, dense[near], width / 2, colours[near])
        self._dot(canvas, points[0], 0.75 * width, colours[0])
        self._dot(canvas, points[0], 0.4 * width, "white")

    def _draw_gripper(self, canvas: ImageDraw.ImageDraw, gripper: NDArray, holds: bool) -> None:
        size = (0.014 + 0.12 * float(gripper[2])) * self.scale
        x, y = self._pixel(gripper)
        box = (x - size, y - size, x + size, y + size)
        canvas.ellipse(box, outline=SPLINE, width=3 * _OVERSAMPLING)
        if holds:
            self._dot(canvas, gripper, 0.007 * self.scale, SPLINE)

    def _dot(self, canvas: ImageDraw.ImageDraw, place: NDArray, size: float, colour: str) -> None:
        x, y = self._pixel(place)
        canvas.ellipse((x - size, y - size, x + size, y + size), fill=colour)

    def _pixel(self, place: NDArray) -> tuple[float, float]:
        x = (place[0] - self.low[0]) * self.scale
        y = (self.high[1] - place[1]) * self.scale + _OVERSAMPLING * _HEADER
        return float(x), float(y)


@cache
def _rope_colours(pieces: int) -> tuple[str, ...]:
    # A dozen steps: the palette has room for them, and they look smooth enough.
    shades = np.round(np.linspace(0.0, 1.0, pieces) * 15) / 15
    return tuple(
        "#{:02x}{:02x}{:02x}".format(*(round(255 * part) for part in ROPE_COLOURS(shade)[:3]))
        for shade in shades
    )


@cache
def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
