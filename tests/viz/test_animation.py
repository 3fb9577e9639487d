from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from knotflow.planning import KnotPlan
from knotflow.viz.animation import animate_plan


def test_animation_lasts_as_long_as_the_plan(plan, tmp_path):
    animate_plan(plan, tmp_path / "plan.gif", width=240)
    with Image.open(tmp_path / "plan.gif") as image:
        milliseconds = 0
        for frame in range(image.n_frames):
            image.seek(frame)
            milliseconds += image.info["duration"]
    simulated = sum(step.times[-1] for step in plan.steps)
    assert simulated < milliseconds / 1000 < simulated + 6.0  # and pauses to look at
    assert (tmp_path / "plan.gif").stat().st_size < 1_000_000


def test_rope_fills_the_view_in_every_step(plan, tmp_path):
    animate_plan(plan, tmp_path / "plan.gif", width=240)
    with Image.open(tmp_path / "plan.gif") as image:
        for frame in range(image.n_frames):
            image.seek(frame)
            view = np.asarray(image.convert("L"))[44:]
            rows, columns = np.nonzero(view < 200)
            assert max(np.ptp(columns) / view.shape[1], np.ptp(rows) / view.shape[0]) > 0.5


def test_plan_without_motion_is_refused(plan, tmp_path):
    with pytest.raises(ValueError, match="without steps"):
        animate_plan(replace(plan, steps=()), tmp_path / "plan.gif")
    still = KnotPlan.from_json(plan.to_json(trajectories=False))
    with pytest.raises(ValueError, match="step 1 has no trajectory"):
        animate_plan(still, tmp_path / "plan.gif")
