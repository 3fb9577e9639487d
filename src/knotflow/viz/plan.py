"""A plan as a picture, after Fig. 9, and as an animation."""

from __future__ import annotations

import textwrap
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from knotflow.planning.plan import KnotPlan
from knotflow.simulation import spline_path
from knotflow.viz.rope import draw_rope, rope_pieces
from knotflow.viz.spline import draw_spline, spline_bounds
from knotflow.viz.style import INK, MUTED, PAPER, SPLINE, WIDTH, inches, save_figure, styled

_MAX_COLUMNS = 4
_MAX_HEIGHT = 2.8  # inches of a panel
_MIN_PANEL = 1.45  # inches, wide enough for its title
_GUTTER = 0.3  # inches at least between panels
_HEADER, _CAPTION = 0.38, 0.44  # inches above and below a panel
_LINE, _MARGIN = 0.17, 0.12  # inches: a line of the footer, the figure's edge
_LETTERS = 120  # in a line of the footer
_PAD = 0.02  # metres round everything in a panel
_BAR = 0.1  # metres
_ENLARGED = 2.5  # times the smallest scale of a row, that of another row at most

_LEGEND = (
    "Rope: head blue with a ring, tail orange.  ● grasp,  ▶ release,  cm: highest point between."
)

_OVERSAMPLING = 2  # drawn larger and scaled down, for smooth edges
_COLOURS = 48  # of the palette; keeps a plan of five steps below 1 MB
_GIF_BANDS = 16  # colours along the rope: as many as the palette has room for
_TITLE = 44  # pixels above the view, for text
_VIEW_ASPECT = 0.62  # of the view, in its width
_PAUSE, _END = 0.8, 2.5  # seconds between steps, and of the last picture
_VIEW_PAD = 0.03  # metres round everything


def draw_plan(plan: KnotPlan, path: Path) -> None:
    """Draw the start with the first spline, and each resulting rope with the next one.

    The suffix of `path` (png, svg, pdf) sets the format.
    """
    save_figure(plan_figure(plan), path)


@styled()
def plan_figure(plan: KnotPlan) -> Figure:
    """The figure of `draw_plan`."""
    count = len(plan.shapes)
    rows = -(-count // _MAX_COLUMNS)
    columns = -(-count // rows)
    corners = np.array([_bounds(plan, index) for index in range(count)])  # low and high, metres
    sizes = np.zeros((rows, columns, 2))  # metres, of the panels that there are
    sizes.reshape(-1, 2)[:count] = corners[:, 1] - corners[:, 0]
    least = _MIN_PANEL * (sizes[..., 0] > 0)
    room = WIDTH - (columns + 1) * _GUTTER
    fitting = np.array([_scale(*row, room) for row in zip(sizes, least, strict=True)])
    scales = np.minimum(fitting, _ENLARGED * fitting.min())  # inches a metre, of each row
    widths = np.maximum(scales[:, None] * sizes[..., 0], least)
    heights = scales * sizes[..., 1].max(axis=1)
    facts = f"{plan.goal}: {plan.kept} of {plan.branches} splines kept, {plan.seconds:.1f} s"
    if not plan.solved:
        facts += f"; {plan.reason}"
    footer = textwrap.wrap(facts, _LETTERS)
    height = sum(heights) + rows * (_HEADER + _CAPTION) + _LINE * (len(footer) + 1) + 2 * _MARGIN
    figure = Figure(figsize=(WIDTH, height))
    canvas = inches(figure)
    for index, (low, high) in enumerate(corners):
        row, column = divmod(index, columns)
        panel, gap = widths[row, column], (WIDTH - widths[row].sum()) / (columns + 1)
        x = widths[row, :column].sum() + (column + 1) * gap
        top = height - sum(heights[:row]) - row * (_HEADER + _CAPTION) - _HEADER
        y = top - heights[row]
        inside = canvas.inset_axes((x, y, panel, heights[row]), transform=canvas.transData)
        inside.axis("off")
        half = np.array([panel, heights[row]]) / scales[row] / 2
        (west, south), (east, north) = (low + high) / 2 - half, (low + high) / 2 + half
        inside.set(xlim=(west, east), ylim=(south, north))
        draw_rope(inside, plan.shapes[index], 2.0 * plan.radius)
        title, colour = ("tied" if plan.solved else "search stopped here"), INK
        if index < len(plan.steps):
            title, colour = f"{index + 1}.  {plan.steps[index].action}", SPLINE
            draw_spline(inside, plan.controls[index], dashed=True)
            _draw_height(inside, plan.controls[index])
        middle = x + panel / 2
        bold: dict[str, Any] = {"weight": "bold", "fontsize": 9 if len(title) < 25 else 8}
        canvas.text(middle, top + 0.12, title, ha="center", color=colour, **bold)
        state = str(plan.states[index])
        label, size = state if index else f"start: {state}", 8 if len(state) < 26 else 6.5
        canvas.text(middle, y - 0.12, label, ha="center", va="top", color=MUTED, fontsize=size)
    for line, text in enumerate([_LEGEND, *footer[::-1]]):
        colour = INK if line else MUTED
        canvas.text(_MARGIN, _MARGIN + line * _LINE, text, color=colour, fontsize=8)
    below = height - np.cumsum(heights + _HEADER + _CAPTION) + _MARGIN
    below[-1] = _MARGIN + 0.04
    for scale, y in zip(scales, below, strict=True):
        bar = WIDTH - _MARGIN - 0.5 - np.array([_BAR * scale, 0.0])
        canvas.plot(bar, [y, y], color=MUTED, linewidth=1.2)
        canvas.text(bar[1], y, "  10 cm", color=MUTED, fontsize=8, va="center")
    return figure


def _scale(sizes: NDArray, least: NDArray, room: float) -> float:
    """Inches a metre, at which panels (C, 2), metres, fit into a row with `room`, inches."""
    scale = _MAX_HEIGHT / float(sizes[:, 1].max())
    while np.maximum(scale * sizes[:, 0], least).sum() > room:
        scale *= 0.99
    return scale


def _bounds(plan: KnotPlan, index: int) -> NDArray[np.float64]:
    """Lower and upper corner (2, 2) of a panel, metres."""
    flat = plan.shapes[index][:, :2]
    if index < len(plan.steps):
        flat = np.concatenate((flat, spline_bounds(plan.controls[index])))
    return np.array([flat.min(axis=0) - _PAD, flat.max(axis=0) + _PAD])


def _draw_height(axes: Axes, controls: NDArray) -> None:
    """The gripper's greatest height, beside its highest point, on the outer side of its path."""
    path = spline_path(controls, np.linspace(0.0, 1.0, 60))
    highest = path[path[:, 2].argmax()]
    outward = controls[1, :2] - (controls[0, :2] + controls[2, :2]) / 2
    outward /= max(float(np.linalg.norm(outward)), 1e-9)
    label, place = f"{highest[2] * 100:.0f} cm", (20 * outward[0], 11 * outward[1])
    style: dict[str, Any] = {"ha": "center", "va": "center", "color": SPLINE, "fontsize": 7}
    style |= {"zorder": 5, "path_effects": [withStroke(linewidth=2.5, foreground=PAPER)]}
    axes.annotate(label, tuple(highest[:2]), place, textcoords="offset points", **style)


def animate_plan(plan: KnotPlan, path: Path, width: int = 600) -> None:
    """Write the plan as a GIF that runs in a loop, `width` pixels wide.

    Each step fills the view: the knot is small where the rope was long. The gripper is a filled
    circle while it holds the rope, and larger the higher it is.

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
            frames.append(view.frame(*texts, points, spline, gripper, time <= step.release_time))
        seconds += [_PAUSE, *np.diff(step.times)]
    title = "tied" if plan.solved else "search stopped here"
    last = plan.shapes[-1]
    frames.append(_View(plan, last, width).frame(title, str(plan.states[-1]), last))
    seconds.append(_END)
    # A GIF counts in hundredths of a second, and viewers slow down what is below two of them.
    milliseconds = [max(20, round(second * 100) * 10) for second in seconds]
    palette = frames[-2].quantize(_COLOURS, dither=Image.Dither.NONE)
    images = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    rest: dict[str, Any] = {"append_images": images[1:], "duration": milliseconds}
    images[0].save(path, format="GIF", save_all=True, loop=0, optimize=True, **rest)


class _View:
    """The part of the table that holds all given points (N, 3), metres, in pixels."""

    def __init__(self, plan: KnotPlan, points: NDArray, width: int) -> None:
        low, high = points[:, :2].min(axis=0) - _VIEW_PAD, points[:, :2].max(axis=0) + _VIEW_PAD
        self._goal = plan.goal if len(plan.goal) < 24 else plan.goal[:21] + "..."
        self._diameter = 2.0 * plan.radius
        self._size = (width, round(_VIEW_ASPECT * width) + _TITLE)
        room = _OVERSAMPLING * np.array([width, _VIEW_ASPECT * width])
        self._scale = float((room / (high - low)).min())  # pixels a metre
        centre = room / 2 + (0, _OVERSAMPLING * _TITLE)
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
        for piece in rope_pieces(points, self._diameter, _GIF_BANDS):
            canvas.polygon(self._pixels(piece.outline), fill=piece.colour)
        if gripper is not None:
            ((x, y),) = self._pixels(gripper[None])
            ring, dot = (0.014 + 0.12 * float(gripper[2])) * self._scale, 0.007 * self._scale
            box = (x - ring, y - ring, x + ring, y + ring)
            canvas.ellipse(box, outline=SPLINE, width=3 * _OVERSAMPLING)
            if holding:
                canvas.ellipse((x - dot, y - dot, x + dot, y + dot), fill=SPLINE)
        return image.reduce(_OVERSAMPLING)

    def _pixels(self, places: NDArray) -> list[tuple[float, float]]:
        """Where places (N, 2 or 3) are in the picture before it is scaled down."""
        pixels = places[:, :2] * self._scale * (1, -1) + self._offset
        return [(float(x), float(y)) for x, y in pixels]


@cache
def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
