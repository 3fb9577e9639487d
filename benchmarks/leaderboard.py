"""Make the tables of docs/leaderboard.md from docs/leaderboard.csv.

Arguments are samplers to measure first, of random, aimed, icp and primitives.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.apps.tasks import evaluate
from knotflow.samplers import IcpConfig, IcpSampler
from knotflow.samplers.demonstrations import NoiseConfig, load_demonstrations, noisy_copies
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES
from knotflow.samplers.sampler import Sampler, SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, Trials, attempt, resample
from knotflow.statistics import wilson
from knotflow.topology import Action

PAGE = Path("docs/leaderboard.md")
COPIES = 12  # noisy, of each shipped demonstration, that ICP interpolates; the paper has 320


def known_sampler(name: str) -> Sampler:
    """A sampler of knotflow: `primitives` those shipped, `icp` with demonstrations copied here."""
    if name != "icp":
        return build_sampler(SamplerConfig(name), {"primitives": Path(SHIPPED_PRIMITIVES)})
    simulator, rng = RopeSimulator(SimulationConfig()), np.random.default_rng(0)
    trials: dict[Action, list[Trials]] = {}
    for one in load_demonstrations():
        points = resample(one.points, simulator.config.rope)
        splines = noisy_copies(one.spline, COPIES, rng, NoiseConfig())
        tried = attempt(simulator, points, splines, one.task.action, one.task.start_state)
        trials.setdefault(one.task.action, []).append(tried)
    return IcpSampler(trials, IcpConfig())


def with_tables(page: str, rows: pd.DataFrame) -> str:
    """The page with its tables made anew, from rows of `evaluate`."""
    parts = [page.partition("\n## Track")[0].rstrip()]
    for track in rows["track"].unique():
        some = rows[rows["track"] == track]
        parts += [f"## Track: {track}", ranking(some), by_task(some)]
    return "\n\n".join(parts) + "\n"


def ranking(rows: pd.DataFrame) -> str:
    """A line a method, the best first."""
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


def by_task(rows: pd.DataFrame) -> str:
    """A line a task, a column a method."""
    counts = rows.groupby(["task", "method"])["success"].agg(["sum", "size"])
    methods, tasks = rows["method"].unique(), rows["task"].unique()
    lines = [f"| task | {' | '.join(methods)} |", "|---" * (len(methods) + 1) + "|"]
    for task in tasks:
        cells = ("{} of {}".format(*counts.loc[(task, method)]) for method in methods)
        lines.append(f"| {task} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(measured: list[str]) -> None:
    """Measure samplers, and write the table and the page."""
    table = PAGE.with_suffix(".csv")
    rows = pd.read_csv(table)
    for name in measured:
        others = rows[rows["method"] != name]
        rows = pd.concat([others, evaluate(known_sampler(name), name)], ignore_index=True)
        rows.to_csv(table, index=False)
    PAGE.write_text(with_tables(PAGE.read_text("utf-8"), rows), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
