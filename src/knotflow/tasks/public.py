"""The public set: ropes and goals on which methods are compared, fixed once and for all.

Two tracks. `actions`: each of the eight topological actions of Fig. 6 from eight ropes, one spline
a rope. `knots`: overhand and figure eight from sixteen random ropes each, at most ten splines a
rope. The ropes were drawn with a seed of their own by `draw`, those in tangled states by aimed
splines that no learned method has touched. Nothing else in knotflow uses them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.demonstrations import TASKS, aim
from knotflow.simulation import RopeSimulator, reached
from knotflow.tasks.task import TieTask

KNOTS = ("overhand", "figure_eight")
ACTION_STARTS = 8
KNOT_STARTS = 16
SPLINES = 10
SEED = 20_201_025
_FILE = Path(__file__).parent / "data" / "public.npz"


def public_tasks(track: str | None = None) -> dict[str, TieTask]:
    """The public tasks of a track, "actions" or "knots", or of both, by name.

    A name is an action such as "C(2,0,1)" or a knot such as "overhand".

    Raises:
        ValueError: an unknown track.
    """
    if track not in (None, "actions", "knots"):
        raise ValueError(f"unknown track {track!r}; choose actions or knots")
    tasks: dict[str, TieTask] = {}
    with np.load(_FILE) as starts:
        if track != "knots":
            actions = [str(one.action) for one in TASKS]
            tasks |= {name: TieTask.single(name, starts[name]) for name in actions}
        if track != "actions":
            tasks |= {name: TieTask.tie(name, starts[name], SPLINES) for name in KNOTS}
    return tasks


def draw(simulator: RopeSimulator) -> dict[str, NDArray[np.float32]]:
    """The starts (N, V, 3) of every public task: what the file with them was made from.

    Other versions of MuJoCo may draw others; the file counts.
    """
    drawn = {}
    for number, task in enumerate(TASKS):
        rng = np.random.default_rng([SEED, number])
        drawn[str(task.action)] = reached(
            task.start_actions, ACTION_STARTS, simulator, aim, rng
        ).points
    for number, name in enumerate(KNOTS, len(TASKS)):
        rng = np.random.default_rng([SEED, number])
        drawn[name] = reached((), KNOT_STARTS, simulator, aim, rng).points
    return {name: points.astype(np.float32) for name, points in drawn.items()}


if __name__ == "__main__":
    from knotflow.simulation import SimulationConfig

    np.savez_compressed(_FILE, **draw(RopeSimulator(SimulationConfig())))  # type: ignore[arg-type]
