from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from PIL import Image

from knotflow.planning import KnotPlan
from knotflow.viz.plan import animate_plan, draw_plan, plan_figure
from knotflow.viz.style import styled


def text_artists(figure):
    """Every text of a figure with one canvas and a panel for each rope."""
    (canvas,) = figure.axes
    return [text for axes in (canvas, *canvas.child_axes) for text in axes.texts]


def texts(figure):
    return [text.get_text() for text in text_artists(figure)]


def test_figure_shows_every_rope_action_and_state(plan):
    figure = plan_figure(plan)
    shown = texts(figure)
    (canvas,) = figure.axes
    for number, action in enumerate(plan.actions, start=1):
        assert f"{number}.  {action}" in shown
    assert "tied" in shown
    assert all(any(str(state) in text for text in shown) for state in plan.states)
    assert len(canvas.child_axes) == len(plan.shapes)
    figure.draw_without_rendering()
    for axes, shape in zip(canvas.child_axes, plan.shapes, strict=True):
        (rope,) = axes.collections
        assert isinstance(rope, PolyCollection)
        low, high = np.sort(axes.transAxes.transform([(0, 0), (1, 1)]), axis=0)
        place = axes.transData.transform(shape[:, :2])
        assert (place > low).all() and (place < high).all()  # nothing is cut off
        metre = np.diff(axes.transData.transform([(0, 0), (1, 1)]), axis=0)[0]
        assert metre[0] == pytest.approx(metre[1])


@pytest.mark.parametrize("goal", ["overhand", " ".join(["C(0,3,1)"] * 40)])
@pytest.mark.parametrize("steps", [0, 2, 3])
def test_texts_do_not_overlap(plan, steps, goal):
    part = replace(plan, steps=plan.steps[:steps], solved=steps == 3, goal=goal, reason="60 s " * 9)
    figure = plan_figure(part)
    with styled():
        renderer = FigureCanvasAgg(figure).get_renderer()
    width, height = figure.bbox.size
    figure.draw(renderer)
    boxes = [text.get_window_extent(renderer) for text in text_artists(figure)]
    for number, box in enumerate(boxes):
        assert box.x0 >= 0 and box.x1 <= width and box.y0 >= 0 and box.y1 <= height
        assert not any(box.overlaps(other) for other in boxes[:number])


@pytest.mark.parametrize("steps", [0, 1, 3])
@pytest.mark.parametrize("ending", ["png", "svg"])
def test_plans_of_any_length_are_drawn(plan, tmp_path, steps, ending):
    part = replace(plan, steps=plan.steps[:steps], solved=steps == 3, reason="30 branches")
    draw_plan(part, tmp_path / f"plan.{ending}")
    assert 5_000 < (tmp_path / f"plan.{ending}").stat().st_size < 1_000_000


@pytest.mark.slow
def test_picture_is_not_blank(plan, tmp_path):
    draw_plan(plan, tmp_path / "plan.png")
    pixels = np.asarray(Image.open(tmp_path / "plan.png").convert("RGB")).reshape(-1, 3)
    assert len(np.unique(pixels, axis=0)) > 100


@pytest.fixture(scope="module")
def animation(plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("animation") / "plan.gif"
    animate_plan(plan, path, width=240)
    return path


@pytest.mark.slow
def test_animation_lasts_as_long_as_the_plan(plan, animation):
    with Image.open(animation) as image:
        milliseconds = 0
        for frame in range(image.n_frames):
            image.seek(frame)
            milliseconds += image.info["duration"]
    simulated = sum(step.times[-1] for step in plan.steps)
    assert simulated < milliseconds / 1000 < simulated + 6.0  # and pauses to look at
    assert animation.stat().st_size < 1_000_000


def test_rope_fills_the_view_in_every_step(animation):
    with Image.open(animation) as image:
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
