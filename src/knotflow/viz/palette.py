"""The colours of all pictures."""

from __future__ import annotations

import numpy as np

INK = "#24292f"
MUTED = "#656d76"
RULE = "#d0d7de"
PAPER = "#ffffff"

GOOD = "#1a7f37"
BAD = "#d1242f"
SPLINE = GOOD
"""Of what the gripper does, where success and failure need not be distinguished."""

OVER = GOOD
UNDER = "#8250df"
"""Of segments that an action lays over and under; the colour-blind tell them apart, too."""

_ROPE = ("#0b5cad", "#2f9bd6", "#8fb8c4", "#f0b25a", "#e8710a")


def rope_colour(along: float) -> str:
    """From blue at the head (0) to orange at the tail (1), as in Fig. 9; '#rrggbb'.

    Legible on light and on dark, and distinguished by the colour-blind.
    """
    stops = np.array([[int(stop[i : i + 2], 16) for i in (1, 3, 5)] for stop in _ROPE])
    places = np.linspace(0.0, 1.0, len(stops))
    return "#" + "".join(f"{round(np.interp(along, places, part)):02x}" for part in stops.T)
