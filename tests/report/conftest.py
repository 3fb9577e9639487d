"""Made-up results folders, written the way a run writes them."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from knotflow import statistics
from knotflow.report import section
from knotflow.report.results import Results
from knotflow.report.sections import SECTIONS

ACTIONS = (
    *("R1(0,1,1)", "R2(0,0,1,1)", "C(0,1,1)", "C(0,2,1)"),
    *("C(2,1,-1)", "C(2,0,-1)", "C(2,0,1)", "C(2,4,1)"),
)
COMMIT = "0123456789abcdef0123456789abcdef01234567"
# Shares of success by method, in the order of ACTIONS: roughly the paper's picture.
SHARES = {
    "random": (0.035, 0.012, 0.0, 0.004, 0.002, 0.006, 0.003, 0.0),
    "icp": (0.31, 0.2, 0.36, 0.17, 0.28, 0.41, 0.2, 0.09),
    "imitation": (0.64, 0.55, 0.52, 0.27, 0.38, 0.55, 0.29, 0.15),
    "reinforcement": (0.93, 0.82, 0.71, 0.45, 0.6, 0.74, 0.56, 0.34),
    "reinforcement_arranged": (0.99, 0.97, 0.96, 0.9, 0.93, 0.95, 0.93, 0.91),
    "actor_only": (0.85, 0.8, 0.66, 0.38, 0.51, 0.68, 0.45, 0.25),
    "critic_only": (0.78, 0.83, 0.6, 0.4, 0.47, 0.65, 0.21, 0.08),
    "actor_critic": (0.93, 0.82, 0.71, 0.45, 0.6, 0.74, 0.56, 0.34),
}
RATE_COLUMNS = ("method", "action", "training_seed", "start", "trials", "successes")
GOAL_COLUMNS = ("set", "goal", "rope_seed", "kept", "simulated", "solved", "seconds", "path")
GOAL_COLUMNS += ("reason",)
ACTION_COLUMNS = ("start", "action", "class", "arranging", "trials", "successes")
BRANCH_COLUMNS = ("start", "training_seed", "seed", "kept", "simulated", "solved", "seconds")
FOUND = ("path", "reason")
PLANNER = {"rule": "paper", "arranging": 3, "use_next_value": True, "guess_fraction": 0.5}
PLANNER |= {"batch": 1, "max_branches": 2000, "max_seconds": 3600.0}

GOALS = (("three", "1o2+3o4+5o6+"), ("three", "1o4+5o2+3o6+"), ("four", "1o2+3o4+5o6+7o8+"))
TRIALS = (
    ("trivial", "R1(0,1,1)", "R1", 0, 20, 18),
    ("trivial", "R1(0,1,1)", "R1", 3, 20, 20),
    ("2o1+", "C(0,1,1)", "Cross, end over", 0, 20, 5),
    ("2o1+", "C(0,1,1)", "Cross, end over", 3, 20, 13),
)

Cells = Iterable[Sequence[object]]


class Writer:
    """Writes tables, run.json and config.yaml below one results folder."""

    def __init__(self, root: Path) -> None:
        self.root = root
        root.mkdir(parents=True, exist_ok=True)

    def table(
        self, experiment: str, name: str, columns: Sequence[str], rows: Cells, budget: str = "paper"
    ) -> Path:
        """A CSV, and a run.json beside it where none stands there yet."""
        path = self.root / experiment / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(rows)
        if not (path.parent / "run.json").exists():
            self.run(experiment, {}, budget)
        return path

    def rates(
        self,
        experiment: str,
        counts: dict[tuple[str, str], tuple[int, int]],
        budget: str = "paper",
        trainings: Sequence[str] = ("",),
    ) -> Path:
        """per_start.csv of successes and trials by method and action: one trial a start."""
        rows = [
            (*key, seed, start, 1, int(start < successes))
            for key, (successes, trials) in counts.items()
            for seed in trainings
            for start in range(trials)
        ]
        return self.table(experiment, "per_start.csv", RATE_COLUMNS, rows, budget)

    def searches(
        self, experiment: str, column: str, rows: Sequence[tuple], trainings: Sequence[str] = ("",)
    ) -> Path:
        """branches.csv from `column`, start, seed, kept, solved and seconds, for each training.

        Twice as many splines were simulated as kept.
        """
        cells = [
            (method, start, training, seed, kept, 2 * kept, solved, seconds)
            + (("C(0,1,1)", "tied") if solved else ("", "gave up"))
            for training in trainings
            for method, start, seed, kept, solved, seconds in rows
        ]
        columns = (column, *BRANCH_COLUMNS, *FOUND)
        return self.table(experiment, "branches.csv", columns, cells)

    def goals(
        self,
        rows: Sequence[tuple[str, str, bool, float]],
        experiment: str = "goals",
        name: str = "goals.csv",
    ) -> Path:
        """goals.csv from set, goal, whether it was tied, and seconds; each rope is its own."""
        tied = ("R1(0,1,1)", "the goal was reached")
        cells = [
            (name, goal, rope, round(4 * seconds), round(40 * seconds), solved, seconds)
            + (tied if solved else ("", "60 s passed"))
            for rope, (name, goal, solved, seconds) in enumerate(rows)
        ]
        return self.table(experiment, name, GOAL_COLUMNS, cells)

    def actions(self, rows: Cells) -> Path:
        """actions.csv as it is."""
        return self.table("actions", "actions.csv", ACTION_COLUMNS, rows)

    def run(
        self, experiment: str, stages: dict[str, dict], budget: str = "paper", **more: object
    ) -> None:
        """run.json and config.yaml."""
        folder = self.root / experiment
        folder.mkdir(parents=True, exist_ok=True)
        run = {"experiment": experiment, "budget": budget, "stages": stages} | more
        (folder / "run.json").write_text(json.dumps(run))
        rope = {"length": 1.0, "radius": 0.008, "links": 40}
        config = {"rollouts": {"config": {"rope": rope}}, "searches": {"config": {}}}
        config["searches"]["config"]["planner"] = PLANNER
        config = {"workflow": experiment, "stages": config}
        (folder / "config.yaml").write_text(yaml.safe_dump(config))

    def body(self, name: str) -> str | None:
        """A section of the report, from what is written by now."""
        results = Results(self.root)
        return SECTIONS[name].body(results, section.Figures(results))


def shares(methods: Sequence[str], trials: int = 400) -> dict[tuple[str, str], tuple[int, int]]:
    """Successes and trials of SHARES."""
    return {
        (method, action): (round(share * trials), trials)
        for method in methods
        for action, share in zip(ACTIONS, SHARES[method], strict=True)
    }


def write_everything(root: Path, budget: str = "paper") -> Writer:
    """All experiments that have a section with figures, all methods."""
    write, rng = Writer(root), np.random.default_rng(1)
    starts = []
    for method in ("random", "icp", "imitation", "reinforcement", "reinforcement_arranged"):
        trained = method in ("imitation", "reinforcement")
        for action, share in zip(ACTIONS, SHARES[method], strict=True):
            shown = rng.beta(0.05 + 3 * share, 0.05 + 3 * (1 - share), size=50)
            for seed in ("10", "11", "12") if trained else ("",):
                hits = rng.binomial(4, shown * (rng.uniform(0.85, 1) if trained else 1))
                starts += [(method, action, seed, i, 4, int(n)) for i, n in enumerate(hits)]
    write.table("single_stage", "per_start.csv", RATE_COLUMNS, starts, budget)
    reached = [(action, i, 1 + i % 7 * 9, int(i % 16 > 0)) for action in ACTIONS for i in range(50)]
    columns = ("action", "start", "splines", "found")
    write.table("single_stage", "reachable.csv", columns, reached, budget)
    write.rates(
        "ablation_actor_critic",
        shares(("actor_only", "critic_only", "actor_critic"), 50),
        budget,
        ("10", "11", "12"),
    )
    options = shares(("reinforcement",), 50)
    write.rates("learning_options", {("ours", action): n for (_, action), n in options.items()})
    trees = []
    for method, spread in (("icp", 40.0), ("imitation", 7.0), ("reinforcement", 0.4)):
        for start, factor in (("straight", 1.0), ("arc", 3.0 if method == "icp" else 0.6)):
            for seed in range(10):
                kept = 3 + int(rng.exponential(spread * factor))
                solved = not (method == "icp" and kept > 250)
                trees.append((method, start, seed, kept, solved, round(kept * 0.11, 2)))
    write.run("tree_size", {}, budget)
    write.searches("tree_size", "method", trees, ("10", "11", "12"))
    joint = [
        (primitives, "random", seed, 3 + int(rng.exponential(mean)), True, 0.5)
        for primitives, mean in (("independent", 1.9), ("joint", 0.7))
        for seed in range(50)
    ]
    write.searches("joint_finetuning", "training", joint, ("10", "11", "12"))
    write.goals(
        [
            (*goal, seconds < 60, seconds)
            for goal, seconds in zip(GOALS, (1.5, 60.2, 4), strict=True)
        ]
    )
    write.actions(TRIALS)
    speeds = [
        ("random splines, straight rope", 40, 1, 200, 9.6, 20.8, 410),
        ("random splines, straight rope", 40, 2, 200, 5.2, 38.4, 480),
        ("random splines, tangled rope", 40, 2, 200, 6.1, 32.7, 480),
    ]
    columns = ("case", "links", "threads", "rollouts", "seconds")
    columns += ("splines_per_second", "peak_memory_mb")
    write.table("benchmark", "throughput.csv", columns, speeds)
    write.run("single_stage", STAGES, budget)
    again = STAGES["demonstrations"] | {"shared": True, "seconds": 0.1}
    write.run("ablation_actor_critic", {"demonstrations": again}, budget)
    return write


def _stage(name: str, signature: str, seconds: float, caption: str) -> dict:
    made = {"stage": name, "signature": signature, "seconds": seconds, "shared": False}
    return made | {"caption": caption, "commit": COMMIT}


STAGES = {
    "demonstrations": _stage("demonstrations", "a1", 512.3, "16,320 noisy copies, simulated"),
    "starts": _stage("starts", "b2", 41.0, "unseen starts of each state"),
    "random": _stage("evaluate", "c3", 88.9, "random sampling"),
    "icp": _stage("evaluate", "d4", 95.2, "ICP interpolation"),
}


@pytest.fixture(scope="module", autouse=True)
def fewer_resamples() -> Iterator[None]:
    """No verdict here is so close that it needs all of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(statistics, "RESAMPLES", 999)
        patch.setattr(statistics, "_drawn", cache(statistics._drawn.__wrapped__))
        yield


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are plotted and not encoded, for tests of the text around them."""
    monkeypatch.setattr(section, "png", lambda figure: b"")


@pytest.fixture
def write(tmp_path: Path) -> Writer:
    """A writer of an empty results folder."""
    return Writer(tmp_path / "results")


@pytest.fixture
def rate_counts() -> Callable[..., dict[tuple[str, str], tuple[int, int]]]:
    """Successes and trials on the eight actions, by method."""
    return shares


@pytest.fixture(scope="session")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A results folder in which every experiment with figures was run. Read only."""
    root = tmp_path_factory.mktemp("everything") / "results"
    write_everything(root)
    return root
