"""The stage that finetunes primitives together, called by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch

from knotflow.demonstrations import TASKS, Trials, aim, task
from knotflow.primitives import (
    FILE,
    CemConfig,
    NetworkConfig,
    Primitive,
    PrimitiveConfig,
    PrimitiveLibrary,
)
from knotflow.recording import load
from knotflow.simulation import SimulationConfig, arc, attempt, resample, straight
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw
from knotflow.training import JointConfig, LearnerConfig
from knotflow.workflow import StageContext
from knotflow.workflow.stages import joint_finetuning as room
from knotflow.workflow.stages.recorder import Recorder

pytestmark = pytest.mark.slow

SIMULATION = SimulationConfig(threads=1)
SMALL = PrimitiveConfig(
    "actor_critic",
    NetworkConfig(lstm=8, attention=4, stream=8, feature=16, head=32),
    CemConfig(population=16, elites=4),
)
CONFIG = room.JointFinetuningConfig(
    path="R1(0,1,1) C(0,1,1) C(2,0,1)",
    seed=40,
    simulation=SIMULATION,
    joint=JointConfig(
        LearnerConfig(demonstration_trials=4, rollout_ropes=8, rollout_trials=1),
        rounds=5,
        episodes=2,
        steps=1,
        decay_steps=1,
        memory=4,
        population=8,
    ),
)


def shape_of(state):
    rope = SIMULATION.rope
    return straight(rope) if not state.crossings else resample(draw(state, samples=40), rope)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory, simulator):
    """Demonstrations and a library that has learnt nothing, with six attempts at R1(0,1,1)."""
    folder, rng = tmp_path_factory.mktemp("inputs"), np.random.default_rng(0)
    (folder / "demonstrations" / "trials").mkdir(parents=True)
    for one in TASKS:
        start = shape_of(one.start_state)
        splines = aim(start, one.action, 5, rng)
        trials = Trials(one.action, start[None], np.zeros(5, int), splines, np.arange(5) < 2)
        trials.save(folder / "demonstrations" / "trials" / f"{one.name}.npz")
    torch.manual_seed(0)
    library = PrimitiveLibrary(
        {number: Primitive(SMALL) for number in (1, 2, 3, 4)},
        {number: [] for number in (1, 2, 3, 4)},
        SIMULATION.rope,
    )
    (folder / "reinforcement").mkdir()
    library.save(folder / "reinforcement" / FILE)
    action = task("R1(0,1,1)").action
    recorder = Recorder(StageContext(folder / "reinforcement"), "reinforcement", SIMULATION.rope)
    for points in (straight(SIMULATION.rope), arc(SIMULATION.rope)):
        splines = aim(points, action, 3, rng)
        attempt(simulator, points, splines, action, TopologicalState.trivial(), recorder)
    recorder.save("recordings/primitive-1-000.mcap")
    return {name: folder / name for name in ("demonstrations", "reinforcement")}


@pytest.fixture(scope="module")
def finetuned(inputs, tmp_path_factory):
    out = tmp_path_factory.mktemp("joint")
    room.finetune(CONFIG, inputs, StageContext(out, "0123456789abcdef"))
    return out


def test_the_library_is_whole_and_only_the_paths_primitives_changed(finetuned, inputs):
    after = PrimitiveLibrary.load(finetuned / FILE, SIMULATION.rope)
    before = PrimitiveLibrary.load(inputs["reinforcement"] / FILE, SIMULATION.rope)
    same = {
        number: all(
            torch.equal(value, before.primitives[number].state_dict()[name])
            for name, value in primitive.state_dict().items()
        )
        for number, primitive in after.primitives.items()
    }
    assert same == {1: False, 2: True, 3: False, 4: False}


def test_every_episode_is_recorded_and_the_curves_go_round_by_round(finetuned):
    rollouts = load(finetuned / "recordings", trajectories=True)
    assert rollouts["number"].is_unique
    assert set(rollouts["source"]) == {"joint_finetuning"}
    first = rollouts[rollouts["action"] == "R1(0,1,1)"]
    assert len(first) <= 5 * 2 * CONFIG.joint.tries
    assert len({points[0].tobytes() for points in first["points"]}) == 5 * 2
    curves = pd.read_csv(finetuned / "curves.csv")
    assert list(curves.columns) == ["primitive", "step", "metric", "value"]
    losses = curves[curves["metric"] == "loss_critic"]
    assert losses.groupby("primitive")["step"].apply(list).to_dict() == {
        number: [0, 1, 2, 3, 4] for number in (1, 3, 4)
    }
    assert not (finetuned / "checkpoints").exists()


def test_an_interrupted_stage_goes_on_and_ends_the_same(finetuned, inputs, tmp_path, monkeypatch):
    save = Recorder.save

    def stop(self, name):
        if name.endswith("004.mcap"):
            raise KeyboardInterrupt
        save(self, name)

    monkeypatch.setattr(Recorder, "save", stop)
    with pytest.raises(KeyboardInterrupt):
        room.finetune(CONFIG, inputs, StageContext(tmp_path, "0123456789abcdef"))
    assert [path.name for path in (tmp_path / "checkpoints").iterdir()] == ["joint-00012"]
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "recordings").glob("*.mcap")}
    monkeypatch.setattr(Recorder, "save", save)
    room.finetune(CONFIG, inputs, StageContext(tmp_path, "0123456789abcdef"))
    assert len(kept) == 4
    assert all(path.stat().st_mtime_ns == mtime for path, mtime in kept.items())
    for name in ("curves.csv", "recordings/joint-004.mcap"):
        assert (tmp_path / name).read_bytes() == (finetuned / name).read_bytes()
    one, other = (PrimitiveLibrary.load(out / FILE) for out in (tmp_path, finetuned))
    for number in (1, 2, 3, 4):
        torch.testing.assert_close(
            one.primitives[number].state_dict(),
            other.primitives[number].state_dict(),
            atol=0,
            rtol=0,
        )


def test_the_newest_attempts_are_remembered(inputs):
    recordings = inputs["reinforcement"] / "recordings"
    table = load(recordings, trajectories=True)
    (all_of_them,) = room.earlier_attempts(recordings, 100)
    (some,) = room.earlier_attempts(recordings, 4)
    assert (len(all_of_them), len(some)) == (6, 4)
    assert (some.action, some.start) == (task("R1(0,1,1)").action, TopologicalState.trivial())
    np.testing.assert_array_equal(some.splines, all_of_them.splines[2:])
    np.testing.assert_array_equal(all_of_them.success, table["outcome"] == "success")
    for row, points in enumerate(table["points"]):
        np.testing.assert_array_equal(all_of_them.points[row], points[0])
        np.testing.assert_array_equal(all_of_them.ends[row], points[-1])
    assert room.earlier_attempts(recordings, 0) == []


def test_a_path_that_cannot_be_read_is_refused(inputs, tmp_path):
    for path in ("R1(0,1,1), C(0,1,1)", "R3(1)", ""):
        with pytest.raises(ValueError):
            room.finetune(replace(CONFIG, path=path), inputs, StageContext(tmp_path))
    assert not list(tmp_path.iterdir())
