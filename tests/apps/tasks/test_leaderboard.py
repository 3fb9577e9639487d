"""The public set is what it says, and a sampler is measured on it."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from knotflow.apps.tasks import TieTask, evaluate, public_tasks
from knotflow.apps.tasks.leaderboard import COLUMNS
from knotflow.samplers.demonstrations import TASKS
from knotflow.simulation import RopeConfig, check_points, straight
from knotflow.topology import TopologicalState, parse_action

ROPE = RopeConfig()
ROOT = Path(__file__).parents[3]
SCRIPTS = sorted(path.name for path in (ROOT / "benchmarks").glob("*.py"))


def test_every_public_start_can_reach_its_goal():
    tasks = public_tasks()
    assert {*tasks} == {"overhand", "figure_eight", *(str(task.action) for task in TASKS)}
    for name, task in tasks.items():
        assert task.starts is not None and len(task.starts) >= 4
        check_points(task.starts, ROPE)
        states = {TopologicalState.from_curve(points) for points in task.starts}
        assert len(states) == 1, name
        assert task.actions(states.pop())


class Careful:
    """Serves R1(0,1,1) only, and leaves the rope as it is."""

    def sample(self, points, action, count, rng):
        if action != parse_action("R1(0,1,1)"):
            raise ValueError("not served")
        return np.tile([0.5, 0.0, 0.0, 0.02, 0.0, 0.0], (count, 1))


def test_episode_ends_without_splines_or_served_action():
    points = straight(ROPE)[None]
    tasks = {
        "served": TieTask.tie("2o1+", points, splines=2),
        "other": TieTask.single("R2(0,0,1,1)", points),
    }
    rows = evaluate(Careful(), "careful", tasks)
    assert list(rows.columns) == COLUMNS
    assert rows[["track", "task", "success", "splines"]].values.tolist() == [
        ["knots", "served", 0, 2],
        ["actions", "other", 0, 0],
    ]


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_finds_all_it_imports(script):
    assert callable(runpy.run_path(str(ROOT / "benchmarks" / script))["main"])


def test_the_page_has_what_was_measured():
    page, rows = (ROOT / "docs" / f"leaderboard.{end}" for end in ("md", "csv"))
    made = runpy.run_path(str(ROOT / "benchmarks" / "leaderboard.py"))["with_tables"]
    assert page.read_text("utf-8") == made(page.read_text("utf-8"), pd.read_csv(rows))
