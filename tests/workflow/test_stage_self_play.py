"""The stage in which primitives learn all actions together, called by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch

from knotflow.recording import load
from knotflow.samplers.demonstrations import TASKS, aim, task
from knotflow.samplers.primitives import (
    FILE,
    CemConfig,
    NetworkConfig,
    Primitive,
    PrimitiveConfig,
    PrimitiveLibrary,
)
from knotflow.samplers.primitives.canonical import ALL_PRIMITIVES, ARRANGE
from knotflow.samplers.primitives.encoding import KINDS
from knotflow.simulation import SimulationConfig, Trials, arc, attempt, resample, straight
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw
from knotflow.training import LearnerConfig, SelfPlayConfig
from knotflow.training.trainer import CHECKPOINT
from knotflow.workflow import StageContext
from knotflow.workflow.stages import self_play as room
from knotflow.workflow.stages.recorder import Recorder

pytestmark = pytest.mark.slow

SIMULATION = SimulationConfig(threads=1)
NETWORK = NetworkConfig(lstm=8, attention=4, stream=8, feature=16, head=16)
SMALL = PrimitiveConfig("actor_critic", NETWORK, CemConfig(population=16, valued=8, elites=4))
CONFIG = room.SelfPlayStageConfig(
    simulation=SIMULATION,
    training=SelfPlayConfig(
        LearnerConfig(demonstration_trials=4, rollout_ropes=8, rollout_trials=1),
        rounds=2, ropes=8, memory=4, steps=1, critic_reset_steps=1, capacity=100,
        refreshed=4,
    ),
    seed=40,
)  # fmt: skip


def shape_of(state):
    rope = SIMULATION.rope
    return straight(rope) if not state.crossings else resample(draw(state, samples=40), rope)


def primitive(number):
    return Primitive(
        replace(SMALL, network=replace(NETWORK, kinds=KINDS)) if number == ARRANGE else SMALL
    )


@pytest.fixture(scope="module")
def inputs(tmp_path_factory, simulator):
    """Demonstrations and a library that has learnt nothing, with six attempts at R1(0,1,1)."""
    folder, rng = tmp_path_factory.mktemp("inputs"), np.random.default_rng(0)
    (folder / "demonstrations" / "trials").mkdir(parents=True)
    for one in TASKS:
        start = shape_of(one.start_state)
        splines = aim(start, one.action, 5, rng)
        points, success = np.stack([start] * 5), np.arange(5) < 2
        trials = Trials(one.action, one.start_state, points, splines, success)
        trials.save(folder / "demonstrations" / "trials" / f"{one.name}.npz")
    torch.manual_seed(0)
    library = PrimitiveLibrary(
        {number: primitive(number) for number in ALL_PRIMITIVES},
        {number: [] for number in ALL_PRIMITIVES},
        SIMULATION.rope,
    )
    (folder / "primitives").mkdir()
    library.save(folder / "primitives" / FILE)
    action = task("R1(0,1,1)").action
    recorder = Recorder(StageContext(folder / "primitives"), "reinforcement", SIMULATION.rope)
    for points in (straight(SIMULATION.rope), arc(SIMULATION.rope)):
        splines = aim(points, action, 3, rng)
        attempt(simulator, points, splines, action, TopologicalState.trivial(), recorder)
    recorder.save("recordings/primitive-1-000.mcap")
    return {name: folder / name for name in ("demonstrations", "primitives")}


@pytest.fixture(scope="module")
def played(inputs, tmp_path_factory):
    out = tmp_path_factory.mktemp("played")
    room.play(CONFIG, inputs, StageContext(out, "0123456789abcdef"))
    return out


def test_the_library_is_whole_and_has_learned(played, inputs):
    after = PrimitiveLibrary.load(played / FILE, SIMULATION.rope)
    before = PrimitiveLibrary.load(inputs["primitives"] / FILE, SIMULATION.rope)
    assert set(after.primitives) == set(ALL_PRIMITIVES)
    changed = [
        any(
            not torch.equal(value, before.primitives[number].state_dict()[name])
            for name, value in after.primitives[number].state_dict().items()
        )
        for number in (1, 2, 3, 4)
    ]
    assert changed == [True] * 4


def test_the_table_counts_the_trials_of_every_pair(played):
    table = pd.read_csv(played / "trials.csv")
    assert list(table.columns) == ["start", "action", "trials", "successes", "recent_rate"]
    assert not table.duplicated(["start", "action"]).any()
    assert (table["trials"] >= table["successes"]).all() and (table["trials"] > 0).all()
    # Four earlier attempts are remembered, and some of the ropes were to be arranged.
    assert 4 < table["trials"].sum() <= 4 + 2 * 8
    assert table["recent_rate"].between(0, 1).all()
    for start in table["start"]:
        TopologicalState.parse(start)


def test_the_curves_go_round_by_round(played):
    curves = pd.read_csv(played / "curves.csv")
    assert list(curves.columns) == ["primitive", "step", "metric", "value"]
    losses = curves[curves["metric"] == "loss_critic"]
    assert losses[losses["primitive"] == 1]["step"].tolist() == [0, 1]
    pairs = curves[curves["metric"] == "pairs_tried"]["value"]
    assert pairs.is_monotonic_increasing
    assert pairs.iloc[-1] == len(pd.read_csv(played / "trials.csv"))
    assert not list(played.rglob(CHECKPOINT))


def test_interrupted_stage_ends_the_same(
    played, inputs, tmp_path, monkeypatch, interrupted_training
):
    monkeypatch.setattr(room, "SAVED_EVERY", 1)
    with interrupted_training(1):
        room.play(CONFIG, inputs, StageContext(tmp_path, "0123456789abcdef"))
    assert len([*tmp_path.rglob(CHECKPOINT)]) == 1
    room.play(CONFIG, inputs, StageContext(tmp_path, "0123456789abcdef"))
    for name in ("curves.csv", "trials.csv"):
        assert (tmp_path / name).read_bytes() == (played / name).read_bytes()
    one, other = (PrimitiveLibrary.load(out / FILE) for out in (tmp_path, played))
    for number in ALL_PRIMITIVES:
        torch.testing.assert_close(
            one.primitives[number].state_dict(),
            other.primitives[number].state_dict(),
            atol=0,
            rtol=0,
        )


def test_the_newest_attempts_are_remembered(inputs):
    recordings = inputs["primitives"] / "recordings"
    table = load(recordings, trajectories=True)
    (all_of_them,) = room.earlier_attempts(recordings, 100)
    (some,) = room.earlier_attempts(recordings, 4)
    assert (len(all_of_them), len(some)) == (6, 4)
    assert (some.action, some.start) == (task("R1(0,1,1)").action, TopologicalState.trivial())
    np.testing.assert_array_equal(some.splines, all_of_them.splines[2:])
    np.testing.assert_array_equal(all_of_them.success, table["outcome"] == "success")
    for row, points in enumerate(table["points"]):
        np.testing.assert_array_equal(all_of_them.points[row], points[0])
        np.testing.assert_array_equal(all_of_them.rollouts.end_points[row], points[-1])
    assert room.earlier_attempts(recordings, 0) == []
