"""Colours, sizes and matplotlib settings of all pictures, the same on every machine."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 8.4
"""Inches: about the width of a code host's page, so that 9 pt reads as 9 pt."""
PNG_DPI = 180

INK = "#24292f"
MUTED = "#656d76"
RULE = "#d0d7de"
PAPER = "#ffffff"
GOOD = "#1a7f37"
BAD = "#d1242f"
SPLINE = GOOD
"""The gripper's path, where success and failure need not be distinguished."""
OVER = GOOD
UNDER = "#8250df"
"""Segments that an action lays over and under; distinguishable by the colour-blind."""

_ROPE = ("#0b5cad", "#2f9bd6", "#8fb8c4", "#f0b25a", "#e8710a")

_STYLE = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same text metrics everywhere
    "font.size": 9,
    "text.color": INK,
    "text.parse_math": False,  # names may contain dollar signs
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


def rope_colour(along: float) -> str:
    """Colour '#rrggbb' from blue at the head (0) to orange at the tail (1), as in Fig. 9.

    Legible on light and dark backgrounds, and distinguishable by the colour-blind.
    """
    stops = np.array([[int(stop[i : i + 2], 16) for i in (1, 3, 5)] for stop in _ROPE])
    positions = np.linspace(0.0, 1.0, len(stops))
    return "#" + "".join(f"{round(np.interp(along, positions, part)):02x}" for part in stops.T)


@contextmanager
def styled() -> Iterator[None]:
    """Our style over matplotlib's own defaults, whatever the user's matplotlibrc says.

    `@styled()` decorates functions, too.
    """
    from matplotlib import style

    with style.context(_STYLE, after_reset=True):  # type: ignore[arg-type]
        yield


def save_figure(figure: Figure, path: Path, dpi: int = PNG_DPI) -> None:
    """Write a figure in our style: a PNG as by `png`, an SVG without its date.

    The suffix sets the format.
    """
    suffix = Path(path).suffix
    with styled():
        if suffix == ".png":
            Path(path).write_bytes(png(figure, dpi))
        else:
            figure.savefig(path, dpi=dpi, metadata={"Date": None} if suffix == ".svg" else {})


def png(figure: Figure, dpi: int = PNG_DPI) -> bytes:
    """The figure with 256 colours and no date or version, so that it is the same each time."""
    from PIL import Image  # slow to import

    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=dpi, metadata={"Software": None})
    image = Image.open(drawn).convert("RGB")
    image = image.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    image.save(small, "PNG", optimize=True)
    return small.getvalue()


def inches(figure: Figure) -> Axes:
    """Axes over the whole figure, in inches."""
    width, height = figure.get_size_inches()
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    return axes
