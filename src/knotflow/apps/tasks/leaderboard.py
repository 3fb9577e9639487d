"""The leaderboard's public tasks, and the success of samplers in them.

Track `actions`: Fig. 6's eight topological actions from six ropes each, one spline a rope. Track
`knots`: overhand and figure eight from sixteen random ropes, at most ten splines a rope. The ropes
were drawn by benchmarks/draw_public_starts.py; benchmarks/leaderboard.py makes the page.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.apps.tasks.environments import TieEnv
from knotflow.apps.tasks.task import TieTask
from knotflow.samplers.demonstrations import TASKS
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import SimulationConfig

KNOTS = ("overhand", "figure_eight")
SPLINES = 10
COLUMNS = ["method", "track", "task", "start", "success", "splines"]


def public_tasks() -> dict[str, TieTask]:
    """The public tasks of both tracks by name: an action such as "C(2,0,1)", or "overhand"."""
    tasks: dict[str, TieTask] = {}
    with np.load(Path(__file__).parent / "data" / "public.npz") as starts:
        for one in TASKS:
            key = " ".join(map(str, one.start_actions)) or "trivial"
            tasks[str(one.action)] = TieTask.single(one.action, starts[key])
        return tasks | {name: TieTask.tie(name, starts["knots"], SPLINES) for name in KNOTS}


def evaluate(
    sampler: Sampler,
    method: str,
    tasks: Mapping[str, TieTask] | None = None,
    simulation: SimulationConfig | None = None,
    seed: int = 0,
) -> pd.DataFrame:
    """Every start of the tasks once, without simulating a spline before it is executed.

    Of the actions that lead on from a rope's state, one is drawn that the sampler serves (it raises
    a ValueError otherwise), and the sampler's first spline for it is executed. A row is an episode
    of the method, with the columns of `COLUMNS`; `splines` counts those it took.
    """
    rows = []
    for number, (name, task) in enumerate((public_tasks() if tasks is None else tasks).items()):
        track = "knots" if task.action is None else "actions"
        env, rng = TieEnv(task, simulation), np.random.default_rng([seed, number])
        for start in range(1 if task.starts is None else len(task.starts)):
            env.reset(seed=seed, options=None if task.starts is None else {"start": start})
            success = _play(env, sampler, rng)
            rows.append((method, track, name, start, int(success), env.used))
    return pd.DataFrame(rows, columns=COLUMNS)


def _play(env: TieEnv, sampler: Sampler, rng: np.random.Generator) -> bool:
    """Whether an episode is won; it ends early where the sampler serves no action."""
    ended = success = False
    while not ended and (spline := _propose(env, sampler, rng)) is not None:
        _, _, terminated, ended, info = env.execute(spline)
        ended, success = ended or terminated, info["is_success"]
    return success


def _propose(env: TieEnv, sampler: Sampler, rng: np.random.Generator) -> NDArray | None:
    """A spline (6,), or None where the sampler serves none of the actions that lead on."""
    actions = env.task.actions(env.state)
    for index in rng.permutation(len(actions)):
        try:
            return sampler.sample(env.points, actions[index], 1, rng)[0]
        except ValueError:
            continue
    return None
