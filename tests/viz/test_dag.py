import pytest
from matplotlib.patches import FancyBboxPatch

from knotflow.planning import Goal, SolutionDag
from knotflow.topology import TopologicalState, Undo, knot, parse_action
from knotflow.viz.dag import dag_figure, draw_dag
from knotflow.viz.style import SPLINE

OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")
PATH = [parse_action(text) for text in ("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)")]


def test_every_state_and_action_is_labelled_and_path_highlighted():
    dag = Goal.state(OVERHAND).dag
    figure = dag_figure(dag, PATH)
    texts = {text.get_text(): text.get_color() for text in figure.axes[0].texts}
    assert {str(state) for state in dag.graph} <= set(texts)
    for state in dag.graph:
        for action, _ in dag.edges_from(state):
            assert (texts[str(action)] == SPLINE) == (action in PATH)
    assert len(figure.axes[0].child_axes) == len(dag)  # a diagram for each state


@pytest.mark.slow
def test_formats_are_reproducible(tmp_path):
    dag = Goal.path(PATH).dag
    paths = [tmp_path / "dag.svg", tmp_path / "dag.png"]
    draw_dag(dag, paths, PATH)
    assert all(2_000 < path.stat().st_size < 500_000 for path in paths)
    before = paths[0].read_bytes()
    draw_dag(dag, paths[:1], PATH)
    assert paths[0].read_bytes() == before


def test_path_outside_the_dag_is_refused():
    dag = Goal.state(OVERHAND).dag
    with pytest.raises(ValueError, match="no edge C"):
        dag_figure(dag, PATH[1:])
    dag_figure(
        dag.after(TopologicalState.trivial().apply(PATH[0])),
        PATH[1:],
        TopologicalState.trivial().apply(PATH[0]),
    )


def test_undo_is_drawn_beside_its_action():
    there = PATH[0]
    dag = SolutionDag.along([there, Undo(there), there])
    figure = dag_figure(dag, [there, Undo(there)])
    (first, second) = (patch.get_path() for patch in figure.axes[0].patches[:2])
    assert {str(there), f"undo {there}"} <= {text.get_text() for text in figure.axes[0].texts}
    assert first.get_extents().x1 < second.get_extents().x0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["slip_knot", "figure_eight"])
def test_labels_lie_on_nothing(name):
    figure = dag_figure(SolutionDag.to(max(knot(name))))
    figure.draw_without_rendering()
    (canvas,) = figure.axes
    labels = [one.get_window_extent() for one in canvas.texts if one.get_zorder() == 3]
    boxes = [one for one in canvas.patches if isinstance(one, FancyBboxPatch)]
    taken = [one.get_window_extent() for one in boxes]
    assert len(labels) > len(taken) > 8
    for number, label in enumerate(labels):
        assert label.count_overlaps([*labels[:number], *taken]) == 0
