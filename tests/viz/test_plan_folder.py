import numpy as np
import pytest

from knotflow.planning import KnotPlan
from knotflow.recording import load
from knotflow.simulation import RopeConfig
from knotflow.viz.plan_folder import PLAN_FILES, STRIDE, subsample, write_plan_folder


@pytest.mark.slow
def test_folder_holds_the_plan_and_its_recording(plan, tmp_path):
    rope = RopeConfig(links=plan.start.shape[0] - 1, radius=plan.radius)
    write_plan_folder(tmp_path, plan, "primitives", rope, request={"knot": "overhand"})
    assert {path.name for path in tmp_path.iterdir()} == set(PLAN_FILES)
    stored = KnotPlan.from_json((tmp_path / "plan.json").read_text("utf-8"))
    np.testing.assert_allclose(stored.shapes, plan.shapes)
    rollouts = load(tmp_path / "plan.mcap")
    assert rollouts["action"].tolist() == [str(step.action) for step in plan.steps]
    assert set(rollouts["outcome"]) == {"success"}


def test_subsample_keeps_first_and_last_frame(plan):
    for step, kept in zip(plan.steps, subsample(plan).steps, strict=True):
        assert len(kept.times) <= len(step.times) / STRIDE + 2
        assert (kept.times[0], kept.times[-1]) == (step.times[0], step.times[-1])
        np.testing.assert_array_equal(kept.trajectory[-1], step.trajectory[-1])
