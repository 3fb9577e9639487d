"""The stages of knotflow: each keeps its contract with files, called by hand."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from knotflow.recording import load
from knotflow.samplers.demonstrations import (
    TASKS,
    load_demonstrations,
    load_trials,
    save_demonstrations,
)
from knotflow.topology import TopologicalState
from knotflow.workflow import StageContext
from knotflow.workflow.stages.demonstrations import DemonstrationsConfig, simulate_demonstrations
from knotflow.workflow.stages.starts import load_starts
from knotflow.workflow.stages.success_rates import SuccessRatesConfig, tabulate

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """A file with one demonstration of each action."""
    path = tmp_path_factory.mktemp("few") / "few.jsonl"
    first = {one.task.name: one for one in reversed(load_demonstrations())}
    save_demonstrations(path, [first[task.name] for task in TASKS])
    return path


@pytest.fixture(scope="module")
def demonstrated(few, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    config = DemonstrationsConfig(copies=6, copies_untangled=4, seed=2, file=str(few))
    simulate_demonstrations(config, {}, StageContext(out, "0123456789abcdef"))
    return config, out


def test_trials_and_recordings_tell_the_same(demonstrated):
    _, out = demonstrated
    rollouts = load(out / "recordings")
    trials = load_trials(out)
    assert (
        len(rollouts) == 2 * 4 + 6 * 6 == sum(len(one) for some in trials.values() for one in some)
    )
    assert sorted(rollouts["number"]) == list(range(len(rollouts)))
    for action, some in trials.items():
        of_action = rollouts[rollouts["action"] == str(action)].sort_values("number")
        assert np.array_equal(
            (of_action["outcome"] == "success").to_numpy(),
            np.concatenate([one.success for one in some]),
        )
        columns = [name for name in rollouts if name.startswith("spline_")]
        splines = np.concatenate([one.splines for one in some])
        assert np.array_equal(of_action[columns].to_numpy(), splines)
    table = pd.read_csv(out / "success.csv")
    assert table["trials"].sum() == len(rollouts)
    assert table["successes"].sum() == (rollouts["outcome"] == "success").sum()


def test_an_interrupted_stage_goes_on_and_ends_the_same(demonstrated, few, tmp_path):
    config, out = demonstrated
    finished = sorted((out / "recordings").glob("*.mcap"))
    for path in finished[:3]:  # as if the others had not been reached
        target = tmp_path / path.relative_to(out)
        target.parent.mkdir(exist_ok=True)
        target.write_bytes(path.read_bytes())
        trials = Path("trials", path.stem + ".npz")
        (tmp_path / "trials").mkdir(exist_ok=True)
        (tmp_path / trials).write_bytes((out / trials).read_bytes())
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "recordings").iterdir()}
    simulate_demonstrations(config, {}, StageContext(tmp_path, "0123456789abcdef"))
    assert all(path.stat().st_mtime_ns == mtime for path, mtime in kept.items())
    for path in finished:
        assert (tmp_path / path.relative_to(out)).read_bytes() == path.read_bytes()


def test_rates_have_wilson_intervals(tmp_path):
    inputs = {}
    for method, hits in (("random", 0), ("icp", 8)):
        folder = tmp_path / method
        folder.mkdir()
        rows = [("R1(0,1,1)", i % 2, int(i < hits)) for i in range(10)]
        pd.DataFrame(rows, columns=["action", "start", "success"]).to_csv(
            folder / "outcomes.csv", index=False
        )
        inputs[method] = folder
    out = tmp_path / "out"
    out.mkdir()
    tabulate(SuccessRatesConfig(), inputs, StageContext(out))
    table = pd.read_csv(out / "success_rates.csv")
    assert list(table.columns) == [
        *("method", "action", "trials", "successes", "success_rate", "ci_low", "ci_high"),
    ]
    assert table["successes"].tolist() == [0, 8]
    # Wilson's interval of 8 in 10, and of 0 in 10, from the published formula.
    np.testing.assert_allclose(table["ci_low"], [0.0, 0.4901625], atol=1e-6)
    np.testing.assert_allclose(table["ci_high"], [0.2775328, 0.9433178], atol=1e-6)
    per_start = pd.read_csv(out / "per_start.csv")
    assert per_start.groupby("method")["successes"].sum().to_dict() == {"icp": 8, "random": 0}


def test_starts_are_in_the_state_of_their_task(tmp_path, monkeypatch):
    from knotflow.workflow.stages import starts

    monkeypatch.setattr(starts, "TASKS", TASKS[:3])
    starts.make_starts(starts.StartsStageConfig(count=2, seed=0), {}, StageContext(tmp_path))
    for task in TASKS[:3]:
        shapes = load_starts(tmp_path, task)
        assert shapes.shape == (2, 41, 3)
        assert {TopologicalState.from_curve(points) for points in shapes} == {task.start_state}
    assert len(load(tmp_path / "recordings")) > 0
    table = pd.read_csv(tmp_path / "starts.csv")
    assert (table["reached"] >= 2).all()
