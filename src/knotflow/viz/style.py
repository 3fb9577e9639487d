"""What matplotlib is set to for all pictures, so that they are the same on every machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from knotflow.viz.palette import INK, MUTED, PAPER, RULE

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


@contextmanager
def styled() -> Iterator[None]:
    """Our style over matplotlib's own defaults, whatever the user's matplotlibrc says."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        for name, value in _STYLE.items():
            matplotlib.rcParams[name] = value  # type: ignore[index]
        yield
