from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from PIL import Image

from knotflow.planning.draw import draw_plan, plan_figure
from knotflow.planning.pictures import ribbon, styled


def texts(figure):
    return [text.get_text() for text in figure.texts] + [
        text.get_text() for axes in figure.axes for text in axes.texts
    ]


def test_the_picture_shows_every_rope_action_and_state(plan):
    with styled():
        figure = plan_figure(plan)
    shown = texts(figure)
    for number, action in enumerate(plan.actions, start=1):
        assert f"{number}.  {action}" in shown
    assert "tied" in shown
    assert all(any(str(state) in text for text in shown) for state in plan.states)
    ropes = [
        axes for axes in figure.axes if any(type(c) is LineCollection for c in axes.collections)
    ]
    assert len(ropes) == len(plan.shapes) + 3  # three of them have crossings to show in close-up


@pytest.mark.parametrize("steps", [0, 1, 3])
@pytest.mark.parametrize("ending", ["png", "svg"])
def test_plans_of_any_length_are_drawn(plan, tmp_path, steps, ending):
    part = replace(plan, steps=plan.steps[:steps], solved=steps == 3, reason="30 branches")
    draw_plan(part, tmp_path / f"plan.{ending}")
    assert 5_000 < (tmp_path / f"plan.{ending}").stat().st_size < 1_000_000


def test_the_picture_is_not_blank(plan, tmp_path):
    draw_plan(plan, tmp_path / "plan.png")
    pixels = np.asarray(Image.open(tmp_path / "plan.png").convert("RGB")).reshape(-1, 3)
    assert len(np.unique(pixels, axis=0)) > 100


def test_under_strands_have_a_gap_at_each_crossing(plan):
    assert not ribbon(plan.shapes[0], 0.008).hidden.any()
    for shape, state in zip(plan.shapes, plan.states, strict=True):
        hidden = ribbon(shape, 0.004).hidden
        assert np.sum(np.diff(hidden.astype(int)) == 1) == state.num_crossings
