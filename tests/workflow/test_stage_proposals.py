"""The stage `proposals`: a small table of what an evaluation recorded, nothing made up."""

import numpy as np
import pandas as pd
import pytest

from knotflow.recording import RecordedRollout, load, write_recording
from knotflow.samplers.demonstrations import TASKS
from knotflow.topology import TopologicalState
from knotflow.workflow import StageContext
from knotflow.workflow.stages import proposals as stage_module
from knotflow.workflow.stages.proposals import ProposalsConfig, propose

TRIALS, STARTS, VERTICES = 4, 3, 41


def loop(rng):
    """A rope in the state of R1(0,1,1), turned at random: its tail end passes over its head end."""
    t = np.linspace(-1.0, 1.0, VERTICES)
    flat = np.column_stack([0.3 * (t**3 - 0.5 * t), 0.3 * t**2])
    turn = rng.uniform(0, 2 * np.pi)
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return np.column_stack([flat @ spin.T, 0.008 + 0.008 * (1 + t)])


def rollout(task, number, start, before, outcome):
    """Two frames, the rope shifted in the second."""
    after = before + [0.1, 0.0, 0.0]
    if outcome == "diverged":
        after = np.full_like(after, np.nan)
    return RecordedRollout(
        times=np.array([0.0, 1.0]),
        points=np.stack([before, after]),
        gripper=np.zeros((2, 3)),
        control_points=np.full((3, 3), 0.01 * number),
        spline=np.zeros(6),
        action=str(task.action),
        start_state=str(task.start_state),
        goal_state=str(task.goal_state),
        end_state="",
        outcome=outcome,
        signature="",
        source="primitives",
        number=number,
        extra={"start": str(start)},
    )


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Starts and an evaluation of all eight tasks; start 1's first rollout blew up."""
    folder, rng = tmp_path_factory.mktemp("inputs"), np.random.default_rng(0)
    starts, evaluation = folder / "starts", folder / "evaluation"
    starts.mkdir()
    (evaluation / "recordings").mkdir(parents=True)
    number = 0
    for task in TASKS:
        shapes = np.stack([loop(rng) for _ in range(STARTS)])
        np.savez(starts / f"{task.name}.npz", points=shapes)
        rollouts = []
        for start, before in enumerate(shapes):
            for trial in range(TRIALS):
                lost = start == 1 and trial == 0
                outcome = "diverged" if lost else ("failure", "success")[number % 2]
                rollouts.append(rollout(task, number, start, before, outcome))
                number += 1
        write_recording(evaluation / "recordings" / f"{task.name}.mcap", rollouts, {})
    return {"starts": starts, "evaluation": evaluation}


def made(inputs, out, **settings):
    propose(ProposalsConfig(**settings), inputs, StageContext(out))
    return pd.read_csv(out / "proposals.csv")


def test_it_says_what_the_recordings_say(inputs, tmp_path):
    table = made(inputs, tmp_path, ropes=2, splines=3)
    assert list(table.columns) == list(stage_module.COLUMNS)
    rollouts = load(inputs["evaluation"] / "recordings", trajectories=True)
    rollouts["start"] = [int(extra["start"]) for extra in rollouts["extra"]]
    assert list(table["action"].unique()) == [str(task.action) for task in TASKS]
    for (action, start), own in table.groupby(["action", "start"]):
        recorded = rollouts[(rollouts["action"] == action) & (rollouts["start"] == start)]
        recorded = recorded.sort_values("number").head(3)
        splines = own[own["what"] == "spline"]
        assert list(splines.groupby("proposal")["outcome"].first()) == list(recorded["outcome"])
        controls = splines[["x", "y", "z"]].to_numpy().reshape(-1, 3, 3)
        np.testing.assert_allclose(controls, np.stack(recorded["control_points"]), atol=6e-4)
        after = own[own["what"] == "after"]
        if start == 1:
            assert after.empty  # it blew up
        else:
            last = recorded.iloc[0]["points"][-1]
            np.testing.assert_allclose(after[["x", "y", "z"]], last, atol=6e-4)
            assert set(after["outcome"]) == {recorded.iloc[0]["outcome"]}


def test_ropes_keep_their_state_in_the_table(inputs, tmp_path):
    table = made(inputs, tmp_path)
    before = table[table["what"] == "before"]
    for (action, start), own in before.groupby(["action", "start"]):
        task = next(task for task in TASKS if str(task.action) == action)
        with np.load(inputs["starts"] / f"{task.name}.npz") as file:
            points = file["points"][start]
        written = TopologicalState.from_curve(own[["x", "y", "z"]].to_numpy())
        assert written == TopologicalState.from_curve(points)
        assert written.num_crossings == 1


def test_the_table_of_full_size_is_small_enough_to_commit(inputs, tmp_path):
    made(inputs, tmp_path)
    kilobytes = (tmp_path / "proposals.csv").stat().st_size / 1000
    assert kilobytes < 300


def test_starts_and_evaluation_must_belong_together(inputs, tmp_path, monkeypatch):
    few = load(inputs["evaluation"] / "recordings", trajectories=True)
    few["extra"] = [{"start": "7"} for _ in range(len(few))]
    monkeypatch.setattr(stage_module, "load", lambda *_, **__: few)
    with pytest.raises(ValueError, match=r"no rollout of R1\(0,1,1\) from start 0"):
        made(inputs, tmp_path)


@pytest.mark.parametrize("name", ["ropes", "splines"])
def test_showing_nothing_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} is 0"):
        ProposalsConfig(**{name: 0})
