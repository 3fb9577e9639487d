"""The leaderboard: `python -m knotflow.apps.tasks.leaderboard [--measure NAME ...]`.

Makes docs/leaderboard.md from docs/leaderboard.csv, after it has measured the samplers that are
named and put their rows in place of older ones. Others' rows come from `evaluate`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.apps.tasks.evaluation import COLUMNS, evaluate
from knotflow.apps.tasks.public import public_tasks
from knotflow.intervals import wilson
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES
from knotflow.samplers.sampler import Sampler, SamplerConfig, build_sampler
from knotflow.topology import Action

TRACKS = ("actions", "knots")
COPIES = 12
"""Noisy copies of each shipped demonstration that ICP interpolates here; the paper has 320."""
_INTRODUCTION = Path(__file__).parent / "data" / "leaderboard.md"


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
    parts = [_INTRODUCTION.read_text("utf-8").rstrip()]
    for track in TRACKS:
        some = rows[rows["track"] == track]
        tables = [_ranking(some), _by_task(some)] if len(some) else ["No method yet."]
        parts += [f"## Track: {track}", *tables]
    return "\n\n".join(parts) + "\n"


def _ranking(rows: pd.DataFrame) -> str:
    order = rows.groupby("method")["success"].mean().sort_values(ascending=False, kind="stable")
    table = []
    for method in order.index:
        some = rows[rows["method"] == method]
        rate = wilson(int(some["success"].sum()), len(some))
        table.append(
            f"| {method} | {some['success'].sum()} of {len(some)} | {rate.estimate:.2f} "
            f"({rate.low:.2f} to {rate.high:.2f}) | {some['splines'].sum()} |"
        )
    return "\n".join(
        ["| method | successes | rate (95 %) | splines |", "|---|---|---|---|", *table]
    )


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
    """A sampler of knotflow: `primitives` those shipped, `icp` with demonstrations copied here.

    Raises:
        ValueError: an unknown name.
    """
    if name == "icp":
        return _icp()
    settings = {"file": str(SHIPPED_PRIMITIVES)} if name == "primitives" else {}
    return build_sampler(SamplerConfig(name, settings), {})


def _icp() -> Sampler:
    from knotflow.samplers import IcpConfig, IcpSampler
    from knotflow.samplers.demonstrations import (
        NoiseConfig,
        load_demonstrations,
        noisy_copies,
    )
    from knotflow.simulation import RopeSimulator, SimulationConfig, Trials, attempt, resample

    simulator, rng = RopeSimulator(SimulationConfig()), np.random.default_rng(0)
    trials: dict[Action, list[Trials]] = {}
    for one in load_demonstrations():
        points = resample(one.points, simulator.config.rope)
        splines = noisy_copies(one.spline, COPIES, rng, NoiseConfig())
        action, start = one.task.action, one.task.start_state
        tried = attempt(simulator, points, splines, action, start)
        trials.setdefault(action, []).append(tried)
    return IcpSampler(trials, IcpConfig())


def main(words: list[str] | None = None) -> None:
    """Read the command line, measure where asked to, and write the page."""
    parser = argparse.ArgumentParser(prog="knotflow.apps.tasks.leaderboard", description=__doc__)
    parser.add_argument("--measure", nargs="+", default=[], metavar="SAMPLER")
    parser.add_argument("--tracks", nargs="+", default=TRACKS, choices=TRACKS)
    parser.add_argument("--table", type=Path, default=Path("docs/leaderboard.csv"))
    asked = parser.parse_args(words)
    rows = pd.DataFrame(columns=list(COLUMNS))
    if asked.table.is_file():
        rows = pd.read_csv(asked.table)
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
