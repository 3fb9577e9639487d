"""The public set: ropes and goals on which methods are compared, fixed once and for all.

Two tracks. `actions`: Fig. 6's eight topological actions, from ropes with no, one or two crossings,
six ropes each, one spline a rope; actions from the same state share their ropes.
`knots`: overhand and figure eight from sixteen random ropes, at most ten splines a rope. The ropes
were drawn with a seed of their own by `draw`, those with a crossing by aimed splines that no
learned method has touched. Nothing else in knotflow uses them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.apps.tasks.task import TieTask
from knotflow.samplers.demonstrations import TASKS, aim
from knotflow.simulation import RopeSimulator, reached
from knotflow.topology import Action

KNOTS = ("overhand", "figure_eight")
ACTION_STARTS = 6
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
            for one in TASKS:
                name = str(one.action)
                tasks[name] = TieTask.single(one.action, starts[_key(one.start_actions)])
        if track != "actions":
            tasks |= {name: TieTask.tie(name, starts[_KNOTS_KEY], SPLINES) for name in KNOTS}
    return tasks


_KNOTS_KEY = "knots"


def _key(start_actions: tuple[Action, ...]) -> str:
    return " ".join(map(str, start_actions)) or "trivial"


def draw(simulator: RopeSimulator) -> dict[str, NDArray[np.float32]]:
    """The starts (N, V, 3) by the actions that lead to their state: what is in the file.

    Other versions of MuJoCo may draw others; the file counts.
    """
    starts = {_key(task.start_actions): task.start_actions for task in TASKS}
    fewest_first = sorted(starts, key=lambda key: len(starts[key]))
    drawn = {}
    for number, key in enumerate([*fewest_first[:2], _KNOTS_KEY, *fewest_first[2:]]):
        rng = np.random.default_rng([SEED, number])  # the order counts: new ones come last
        actions, count = starts.get(key, ()), KNOT_STARTS if key == _KNOTS_KEY else ACTION_STARTS
        drawn[key] = reached(actions, count, simulator, aim, rng).points.astype(np.float32)
    return drawn


if __name__ == "__main__":
    from knotflow.simulation import SimulationConfig

    np.savez_compressed(_FILE, **draw(RopeSimulator(SimulationConfig())))  # type: ignore[arg-type]
