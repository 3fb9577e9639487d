"""The leaderboard: `python -m knotflow.apps.tasks.leaderboard [--measure NAME ...]`.

Makes docs/leaderboard.md from docs/leaderboard.csv, after measuring the named samplers anew.

Track `actions`: Fig. 6's eight topological actions from six ropes each, one spline a rope. Track
`knots`: overhand and figure eight from sixteen random ropes, at most ten splines a rope. The ropes
were drawn by benchmarks/draw_public_starts.py.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.apps.tasks.task import Episodes, TieTask
from knotflow.samplers.demonstrations import TASKS
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES
from knotflow.samplers.sampler import Sampler, SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig
from knotflow.statistics import wilson
from knotflow.topology import Action

TRACKS = ("actions", "knots")
KNOTS = ("overhand", "figure_eight")
SPLINES = 10
COLUMNS = ("method", "track", "task", "start", "success", "splines")
COPIES = 12  # noisy, of each shipped demonstration, that ICP interpolates; the paper has 320
REST_SPLINE = np.array([0.5, 0.0, 0.0, 0.02, 0.0, 0.0])  # for ropes whose episode is over
_DATA = Path(__file__).parent / "data"


def public_tasks(track: str | None = None) -> dict[str, TieTask]:
    """The public tasks of a track, "actions" or "knots", or of both, by name.

    A name is an action such as "C(2,0,1)" or a knot such as "overhand".

    Raises:
        ValueError: an unknown track.
    """
    if track not in (None, *TRACKS):
        raise ValueError(f"unknown track {track!r}; choose {' or '.join(TRACKS)}")
    tasks: dict[str, TieTask] = {}
    with np.load(_DATA / "public.npz") as starts:
        if track != "knots":
            for one in TASKS:
                name = str(one.action)
                key = " ".join(map(str, one.start_actions)) or "trivial"
                tasks[name] = TieTask.single(one.action, starts[key])
        if track != "actions":
            tasks |= {name: TieTask.tie(name, starts["knots"], SPLINES) for name in KNOTS}
    return tasks


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
        splines = np.tile(REST_SPLINE, (count, 1))
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


def page(rows: pd.DataFrame) -> str:
    """The leaderboard in Markdown, from rows with the columns of `evaluate`.

    Raises:
        ValueError: rows of another shape, or an episode that is listed twice.
    """
    if set(COLUMNS) - set(rows.columns):
        raise ValueError(f"a leaderboard has the columns {', '.join(COLUMNS)}; got {[*rows]}")
    twice = rows[rows.duplicated(["method", "task", "start"])]
    if len(twice):
        raise ValueError(f"measured twice: {twice.iloc[0][['method', 'task', 'start']].tolist()}")
    parts = [(_DATA / "leaderboard.md").read_text("utf-8").rstrip()]
    for track in TRACKS:
        some = rows[rows["track"] == track]
        tables = [_ranking(some), _by_task(some)] if len(some) else ["No method yet."]
        parts += [f"## Track: {track}", *tables]
    return "\n\n".join(parts) + "\n"


def _ranking(rows: pd.DataFrame) -> str:
    order = rows.groupby("method")["success"].mean().sort_values(ascending=False, kind="stable")
    lines = ["| method | successes | rate (95 %) | splines |", "|---|---|---|---|"]
    for method in order.index:
        some = rows[rows["method"] == method]
        rate = wilson(int(some["success"].sum()), len(some))
        lines.append(
            f"| {method} | {some['success'].sum()} of {len(some)} | {rate.estimate:.2f} "
            f"({rate.low:.2f} to {rate.high:.2f}) | {some['splines'].sum()} |"
        )
    return "\n".join(lines)


def _by_task(rows: pd.DataFrame) -> str:
    counts = rows.groupby(["task", "method"], sort=False)["success"].agg(["sum", "size"])
    methods = rows["method"].unique().tolist()
    lines = [f"| task | {' | '.join(methods)} |", "|---" * (len(methods) + 1) + "|"]
    for task in rows["task"].unique():
        cells = [
            "{} of {}".format(*counts.loc[(task, method)]) if (task, method) in counts.index else ""
            for method in methods
        ]
        lines.append(f"| {task} | {' | '.join(cells)} |")
    return "\n".join(lines)


def known_sampler(name: str) -> Sampler:
    """A sampler of knotflow: `primitives` those shipped, `icp` with demonstrations copied here."""
    if name != "icp":
        return build_sampler(SamplerConfig(name), {"primitives": Path(SHIPPED_PRIMITIVES)})
    from knotflow.samplers import IcpConfig, IcpSampler
    from knotflow.samplers.demonstrations import NoiseConfig, load_demonstrations, noisy_copies
    from knotflow.simulation import Trials, attempt, resample

    simulator, rng = RopeSimulator(SimulationConfig()), np.random.default_rng(0)
    trials: dict[Action, list[Trials]] = {}
    for one in load_demonstrations():
        points = resample(one.points, simulator.config.rope)
        splines = noisy_copies(one.spline, COPIES, rng, NoiseConfig())
        tried = attempt(simulator, points, splines, one.task.action, one.task.start_state)
        trials.setdefault(one.task.action, []).append(tried)
    return IcpSampler(trials, IcpConfig())


def main(words: list[str] | None = None) -> None:
    """Read the command line, measure where asked to, and write the page."""
    parser = argparse.ArgumentParser(prog="knotflow.apps.tasks.leaderboard", description=__doc__)
    parser.add_argument("--measure", nargs="+", default=[], metavar="SAMPLER")
    parser.add_argument("--tracks", nargs="+", default=TRACKS, choices=TRACKS)
    parser.add_argument("--table", type=Path, default=Path("docs/leaderboard.csv"))
    asked = parser.parse_args(words)
    known = asked.table.is_file()
    rows = pd.read_csv(asked.table) if known else pd.DataFrame(columns=list(COLUMNS))
    for name in asked.measure:
        method = known_sampler(name)
        for track in asked.tracks:
            measured = evaluate(method, name, public_tasks(track))
            older = (rows["method"] == name) & (rows["track"] == track)
            rows = pd.concat([rows[~older], measured], ignore_index=True)
        rows.to_csv(asked.table, index=False)
    if rows.empty:
        parser.error(f"{asked.table} has no rows; --measure random measures some")
    asked.table.with_suffix(".md").write_text(page(rows), "utf-8")


if __name__ == "__main__":
    main()
