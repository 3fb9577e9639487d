"""What a search has to know of the arm that executes its plans."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.plan import KnotPlan
from knotflow.topology.polyline import Floats


class Reach(Protocol):
    """An arm's reach, in the frame of the searched rope; see `execution.ArmReach`."""

    def may_follow(self, points: Floats, splines: Floats) -> NDArray[np.bool_]:
        """Which of splines (N, 6) on a rope (V, 3), metres, the arm can likely follow: (N,)."""
        ...

    def first_failed(self, plan: KnotPlan) -> int | None:
        """The first step that the arm cannot follow or that fails by it, None without any."""
        ...
