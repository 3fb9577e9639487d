"""What a person demonstrated trains primitives."""

import numpy as np
import pytest

from knotflow.apps.studio.session import Session
from knotflow.samplers.demonstrations import TASKS, load_demonstrations
from knotflow.simulation import check_splines, resample
from knotflow.training import ImitationConfig

pytestmark = pytest.mark.slow

CAMERA = np.array([0.0, -0.55, 1.05])
ACTIONS = ("R1(0,1,1)", "R2(0,0,1,1)", "C(0,1,1)", "C(2,0,1)")
"""One for each primitive."""


def demonstrate(session, action):
    """Lay a start, click where the shipped demonstration of that start went, and keep it."""
    named = f"start of {action}"
    session.lay_named("straight" if action[0] == "R" else named)
    rope = session.simulation.rope
    shown = min(
        (one for one in load_demonstrations() if str(one.task.action) == action),
        key=lambda one: np.abs(resample(one.points, rope) - session.points).max(),
    )
    draft = session.begin(shown.task.action)
    along = np.linspace(0, 1, len(session.points))
    grasp = [np.interp(shown.spline[0], along, column) for column in session.points.T]
    for place in (grasp, [*shown.spline[1:3], rope.radius], [*shown.spline[4:], rope.radius]):
        draft.click(CAMERA, np.array(place) - CAMERA)
    draft.height = float(shown.spline[3])
    assert session.simulate().success[0]
    session.keep("Ada")


def test_three_clicks_a_primitive_train_a_library(imitated, tmp_path):
    session = Session("straight", tmp_path / "ada.jsonl")
    for action in ACTIONS:
        demonstrate(session, action)
    library = imitated(session.file, tmp_path, 3, 6, ImitationConfig(steps=2, validations=1))
    assert {str(one) for some in library.trained_on.values() for one in some} == set(ACTIONS)
    rng = np.random.default_rng(0)
    check_splines(library.sample(session.kept()[0].points, TASKS[0].action, 2, rng))
