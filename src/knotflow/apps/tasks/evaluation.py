"""A sampler on public tasks: one row an episode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.apps.tasks.episodes import Episodes
from knotflow.apps.tasks.public import public_tasks
from knotflow.apps.tasks.task import TieTask
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import RopeSimulator, SimulationConfig

COLUMNS = ("method", "track", "task", "start", "success", "splines")


def evaluate(
    sampler: Sampler,
    method: str,
    tasks: Mapping[str, TieTask] | None = None,
    simulation: SimulationConfig | None = None,
    seed: int = 0,
) -> pd.DataFrame:
    """Every start of the tasks once, without simulating a spline before it is executed.

    Of the actions that lead on from a rope's state, one is drawn that the sampler serves, and the
    sampler's first spline for it is executed.

    Args:
        sampler: proposes the splines. A ValueError says that it does not serve an action.
        method: its name in the table.
        tasks: all public ones if None.
        simulation: how splines are executed.
        seed: of all that is random.

    Returns:
        A row an episode with the columns of `COLUMNS`; `splines` counts those it took.
    """
    simulator = RopeSimulator(simulation or SimulationConfig())
    rows: list[tuple[Any, ...]] = []
    tasks = public_tasks() if tasks is None else tasks
    for number, (name, task) in enumerate(tasks.items()):
        track = "knots" if task.action is None else "actions"
        rng = np.random.default_rng([seed, number])
        for start, (success, used) in enumerate(_play(task, sampler, simulator, rng)):
            rows.append((method, track, name, start, int(success), used))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _play(
    task: TieTask, sampler: Sampler, simulator: RopeSimulator, rng: np.random.Generator
) -> list[tuple[bool, int]]:
    """Success and splines of an episode from each start, all of them simulated side by side."""
    count = 1 if task.starts is None else len(task.starts)
    episodes = Episodes(task, count, simulator)
    for row in range(count):
        episodes.reset(row, rng, None if task.starts is None else row)
    playing, success = np.ones(count, bool), np.zeros(count, bool)
    used = np.zeros(count, int)
    while playing.any():
        splines = np.tile(_REST, (count, 1))
        for row in np.flatnonzero(playing).tolist():
            proposed = _propose(task, episodes, row, sampler, rng)
            if proposed is None:
                playing[row] = False
            else:
                splines[row] = proposed
        outcome = episodes.step(splines)
        used += playing
        success |= playing & outcome.success
        playing &= ~(outcome.terminated | outcome.truncated)
    return list(zip(success.tolist(), used.tolist(), strict=True))


_REST = np.array([0.5, 0.0, 0.0, 0.02, 0.0, 0.0])
"""What moves the ropes whose episode is over; they count no more."""


def _propose(
    task: TieTask, episodes: Episodes, row: int, sampler: Sampler, rng: np.random.Generator
) -> NDArray | None:
    """A spline (6,) for one rope, or None where the sampler serves none of its actions."""
    actions = task.actions(episodes.states[row])
    for index in rng.permutation(len(actions)):
        try:
            return sampler.sample(episodes.points[row], actions[index], 1, rng)[0]
        except ValueError:
            continue
    return None
