"""The stages that take a library to many goals and actions, called by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from knotflow.planning import KnotPlan, PlannerConfig
from knotflow.recording import load
from knotflow.samplers.aimed import AimedSampler
from knotflow.samplers.demonstrations import nudge
from knotflow.samplers.sampler import SamplerConfig
from knotflow.simulation import SimulationConfig
from knotflow.topology.symmetry import distinct_actions, representative
from knotflow.workflow import StageContext
from knotflow.workflow.stages import actions, goals, library
from knotflow.workflow.stages.plans import read_searches

SIMULATION = SimulationConfig(threads=1)
AIMED = SamplerConfig("aimed")
SEARCH = PlannerConfig(batch=8, max_branches=64)
GOALS = goals.GoalsConfig(
    simulation=SIMULATION,
    sampler=AIMED,
    planner=SEARCH,
    sets=[goals.GoalSet("one", 1, 2), goals.GoalSet("two", 2, 1)],
    seed=5,
)


def test_goals_are_drawn_once_each_and_depend_on_the_seed_alone():
    sets = [goals.GoalSet("two", 2, 25), goals.GoalSet("three", 3, 60)]
    drawn = goals.drawn_goals(sets, 7)
    assert len(drawn) == 85
    by_set = {
        one.name: [state for name, _, state in drawn.values() if name == one.name] for one in sets
    }
    for one in sets:
        states = by_set[one.name]
        assert len(set(states)) == one.count
        assert {state.num_crossings for state in states} == {one.crossings}
    assert drawn == goals.drawn_goals(sets, 7) != goals.drawn_goals(sets, 8)
    # Fewer goals are the first of more, whatever other sets there are.
    few = goals.drawn_goals([goals.GoalSet("three", 3, 5)], 7)
    assert [state for _, _, state in few.values()] == by_set["three"][:5]


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    out = tmp_path_factory.mktemp("goals")
    goals.search_goals(GOALS, {}, StageContext(out, "0123456789abcdef"))
    return out


@pytest.mark.slow
def test_every_goal_has_a_row_a_plan_and_its_branches_recorded(searched):
    table = read_searches(searched / "goals.csv")
    assert list(table.columns) == [
        *("set", "goal", "rope_seed", "solved", "branches", "seconds", "nodes", "path"),
        *("knot_type", "confirmed", "reason"),
    ]
    assert table["set"].tolist() == ["one", "one", "two"]
    assert table["solved"].tolist()[:2] == [True, True]
    rollouts = load(searched / "recordings")
    assert rollouts["number"].is_unique and len(rollouts) == table["branches"].sum()
    drawn = goals.drawn_goals(GOALS.sets, GOALS.seed)
    for row, (name, (_, number, state)) in zip(table.itertuples(), drawn.items(), strict=True):
        plan = KnotPlan.from_json((searched / "plans" / f"{name}.json").read_text())
        assert (row.goal, row.rope_seed) == (str(state), number)
        assert plan.solved == row.solved and bool(row.path) == row.solved
        if row.solved:
            assert plan.states[-1] == state


@pytest.mark.slow
def test_interrupted_goals_go_on_and_end_the_same(searched, tmp_path):
    for path in ("rows/one-001.csv", "plans/one-001.json", "recordings/one-001.mcap"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_bytes((searched / path).read_bytes())
    kept = (tmp_path / "rows" / "one-001.csv").stat().st_mtime_ns
    goals.search_goals(GOALS, {}, StageContext(tmp_path, "0123456789abcdef"))
    assert (tmp_path / "rows" / "one-001.csv").stat().st_mtime_ns == kept
    one, other = (
        read_searches(out / "goals.csv").drop(columns="seconds") for out in (searched, tmp_path)
    )
    pd.testing.assert_frame_equal(one, other)


class Arranging(AimedSampler):
    """Aimed guesses, and small motions that shall make room."""

    def arrange(self, points, action, count, rng):
        return nudge(points, count, rng)

    def values(self, points, actions, rng):
        return np.zeros(len(points))

    def arranged_values(self, points, actions, rng):
        return np.ones(len(points))


def test_one_state_of_each_class_is_a_start():
    starts = actions.start_states(3)
    assert len(starts) == len(set(starts)) == len({representative(state)[0] for state in starts})
    assert {state.num_crossings for state in starts} == {0, 1, 2}
    assert sum(
        onward.num_crossings <= 3 for state in starts for _, onward in distinct_actions(state)
    ) == 396  # fmt: skip


@pytest.mark.slow
def test_actions_are_tried_with_and_without_arranging(tmp_path, monkeypatch):
    monkeypatch.setattr(actions, "build_sampler", lambda config, inputs: Arranging())
    starts = actions.start_states(2)
    monkeypatch.setattr(actions, "start_states", lambda most: starts[:2])
    monkeypatch.setattr(actions, "distinct_actions", lambda state: distinct_actions(state)[:2])
    config = actions.ActionsConfig(
        simulation=SIMULATION, planner=SEARCH, most_crossings=2, count=2, arranging=1, seed=3
    )
    actions.try_actions(config, {}, StageContext(tmp_path))
    table = pd.read_csv(tmp_path / "actions.csv")
    assert list(table.columns) == [
        *("start", "action", "class", "arranging", "trials", "successes"),
    ]
    assert table["arranging"].tolist() == [0, 1] * (len(table) // 2)
    assert not table.duplicated(["start", "action", "arranging"]).any()
    assert table["start"].iloc[0] == str(starts[0]) and (table["trials"] <= 2).all()
    assert (table["successes"] <= table["trials"]).all()
    assert set(table["class"]) <= set(actions.CLASSES.values())


def test_a_library_is_taken_as_it_is(tmp_path):
    import torch

    from knotflow.config import SHIPPED_PRIMITIVES
    from knotflow.samplers.primitives import FILE, PrimitiveLibrary

    config = library.LibraryConfig(file=str(SHIPPED_PRIMITIVES), contents="shipped")
    library.take(config, {}, StageContext(tmp_path))
    taken, given = (PrimitiveLibrary.load(path) for path in (tmp_path / FILE, SHIPPED_PRIMITIVES))
    assert set(taken.primitives) == set(given.primitives)
    for number, one in given.primitives.items():
        torch.testing.assert_close(
            taken.primitives[number].state_dict(), one.state_dict(), atol=0, rtol=0
        )
    with pytest.raises(FileNotFoundError):
        library.take(library.LibraryConfig(file="nowhere", contents=""), {}, StageContext(tmp_path))
