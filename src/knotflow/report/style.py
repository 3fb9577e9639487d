"""A figure of the report, and how it is turned into bytes that are the same each time."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knotflow.viz.style import INK, MUTED, PAPER, PNG_DPI, RULE, WIDTH, styled

__all__ = [
    "INK",
    "MUTED",
    "PAPER",
    "RULE",
    "WIDTH",
    "Picture",
    "bare_axis",
    "new_figure",
    "render",
    "styled",
    "without_blanks",
]


@dataclass(frozen=True)
class Picture:
    """A rendered figure: its file name without ending, two forms, and what it shows in words."""

    name: str
    png: bytes
    svg: bytes
    alt: str


def new_figure(height: float) -> Figure:
    """An empty figure of the report's width, `height` in inches. Call it within `styled()`."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def render(figure: Figure, name: str, alt: str) -> Picture:
    """The figure as PNG and SVG without date, version or other metadata that would change.

    Both have the layout found for the PNG: finding it takes longer than drawing.
    """
    png, svg = io.BytesIO(), io.BytesIO()
    figure.savefig(png, format="png", dpi=PNG_DPI, metadata={"Software": None})
    figure.set_layout_engine(None)
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    figure.savefig(svg, format="svg", metadata=nothing)
    return Picture(name, png.getvalue(), without_blanks(svg.getvalue()), alt)


def without_blanks(svg: bytes) -> bytes:
    """matplotlib ends lines of path data with blanks, which a repository does not like."""
    return re.sub(rb"[ \t]+$", b"", svg, flags=re.MULTILINE)


def bare_axis(axes: Axes, *, grid: str) -> None:
    """No frame and no tick marks; thin grid lines along one axis ('x' or 'y')."""
    axes.tick_params(length=0)
    axes.grid(axis=grid)  # type: ignore[arg-type]
    for spine in axes.spines.values():
        spine.set_visible(False)
