"""The public set is what it says, and a sampler is measured on it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from knotflow.apps.tasks import TieTask, evaluate, public_tasks
from knotflow.apps.tasks.leaderboard import COLUMNS, known_sampler, main, page
from knotflow.samplers import demonstrations
from knotflow.samplers.demonstrations import TASKS, load_demonstrations
from knotflow.simulation import RopeConfig, check_points, check_splines, straight
from knotflow.topology import TopologicalState, parse_action

ROPE = RopeConfig()


def test_every_public_start_can_reach_its_goal():
    tasks = public_tasks()
    assert len(tasks) == 10
    for name, task in tasks.items():
        assert task.starts is not None and len(task.starts) >= 4
        check_points(task.starts, ROPE)
        states = {TopologicalState.from_curve(points) for points in task.starts}
        assert len(states) == 1, name
        assert task.actions(states.pop())


def test_tracks_select_tasks():
    assert set(public_tasks("knots")) == {"overhand", "figure_eight"}
    assert set(public_tasks("actions")) == {str(task.action) for task in TASKS}
    with pytest.raises(ValueError, match="choose actions or knots"):
        public_tasks("pentagram")


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
    assert list(rows.columns) == list(COLUMNS)
    assert rows[["track", "task", "success", "splines"]].values.tolist() == [
        ["knots", "served", 0, 2],
        ["actions", "other", 0, 0],
    ]


@pytest.mark.parametrize("name", ["random", "aimed", "icp", "primitives"])
def test_known_samplers_propose_splines(name, rng, monkeypatch):
    first = load_demonstrations()[:1]  # of R1(0,1,1); simulating copies of all takes a while
    monkeypatch.setattr(demonstrations, "load_demonstrations", lambda: first)
    splines = known_sampler(name).sample(straight(ROPE), parse_action("R1(0,1,1)"), 2, rng)
    assert check_splines(splines).shape == (2, 6)


def test_page_ranks_methods_with_intervals(tmp_path):
    rows = pd.DataFrame(
        [(m, "actions", "R1(0,1,1)", s, int(s < k), 1) for m, k in [("a", 1), ("b", 3)]
         for s in range(4)],
        columns=list(COLUMNS),
    )  # fmt: skip
    text = page(rows)
    assert text.index("| b | 3 of 4 | 0.75 (0.30 to 0.95) | 4 |") < text.index("| a | 1 of 4 |")
    assert "| R1(0,1,1) | 1 of 4 | 3 of 4 |" in text
    with pytest.raises(ValueError, match="measured twice"):
        page(pd.concat([rows, rows]))
    rows.to_csv(tmp_path / "leaderboard.csv", index=False)
    main(["--table", str(tmp_path / "leaderboard.csv")])
    assert (tmp_path / "leaderboard.md").read_text() == text
