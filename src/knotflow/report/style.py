"""How the figures look, and how one is turned into bytes that are the same each time."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK = "#24292f"
MUTED = "#656d76"
RULE = "#d0d7de"
PAPER = "#ffffff"

# The page's stylesheet has a light and a dark value for each of these; a figure inlined there
# follows it. The arms' own colours are legible on both.
_THEMED = {
    INK: "var(--figure-ink)",
    MUTED: "var(--figure-muted)",
    RULE: "var(--figure-rule)",
    PAPER: "var(--figure-paper)",
}

#: Inches. At 8.4 in a figure is about as wide as a code host's page, so that 9 pt reads as 9 pt.
WIDTH = 8.4
PNG_DPI = 180

_STYLE = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same text metrics everywhere
    "font.size": 9,
    "text.color": INK,
    "text.parse_math": False,  # a name with a dollar sign is a name
    "axes.edgecolor": RULE,
    "axes.labelcolor": MUTED,
    "axes.labelsize": 8.5,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "figure.facecolor": PAPER,
    "axes.facecolor": "none",
    "savefig.facecolor": PAPER,
    "svg.fonttype": "none",
    "svg.hashsalt": "knotflow",
}


@dataclass(frozen=True)
class Picture:
    """A rendered figure: its file name without ending, two forms, and what it shows in words."""

    name: str
    png: bytes
    svg: bytes
    alt: str

    def inline(self) -> str:
        """The SVG to stand within a page: its ids its own, its greys the page's."""
        svg = self.svg.decode("utf-8")
        svg = svg[svg.index("<svg") :]
        svg = re.sub(r'\b(id="|xlink:href="#|url\(#)', rf"\g<1>{self.name}-", svg)
        # The page's width rules; the viewBox keeps the shape.
        svg = re.sub(r'<svg([^>]*?) height="[^"]*"', r"<svg\1", svg, count=1)
        svg = re.sub(r'<svg([^>]*?) width="[^"]*"', r"<svg\1", svg, count=1)
        for grey, variable in _THEMED.items():
            svg = svg.replace(grey, variable)
        return svg.replace("<svg", '<svg role="img"', 1).strip()


def new_figure(height: float) -> Figure:
    """An empty figure of the report's width, `height` in inches. Call it within `styled()`."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


@contextmanager
def styled() -> Iterator[None]:
    """The report's style over matplotlib's own defaults, whatever the user's matplotlibrc says."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        for name, value in _STYLE.items():
            matplotlib.rcParams[name] = value  # type: ignore[index]
        yield


def render(figure: Figure, name: str, alt: str) -> Picture:
    """The figure as PNG and SVG without date, version or other metadata that would change."""
    png, svg = io.BytesIO(), io.BytesIO()
    figure.savefig(png, format="png", dpi=PNG_DPI, metadata={"Software": None})
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    figure.savefig(svg, format="svg", metadata=nothing)
    # matplotlib ends lines of path data with blanks, which a repository does not like.
    clean = re.sub(rb"[ \t]+$", b"", svg.getvalue(), flags=re.MULTILINE)
    return Picture(name, png.getvalue(), clean, alt)


def bare_axis(axes: Axes, *, grid: str) -> None:
    """No frame and no tick marks; thin grid lines along one axis ('x' or 'y')."""
    axes.tick_params(length=0)
    axes.grid(axis=grid)  # type: ignore[arg-type]
    for spine in axes.spines.values():
        spine.set_visible(False)
