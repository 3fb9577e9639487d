"""Executions are compared on the same twins, and each failure has a cause."""

import pytest
import yaml

from knotflow.report import closed_loop, dynamics
from knotflow.report.page import compose
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Pictures

COLUMNS = ("controller", "level", "twin", "knot", "fault", "tied", "reported", "actions_done")
COLUMNS += ("mean_deviation_mm", "seconds", "planning_seconds", "image_ms", "track_ms", "mppi_ms")
COLUMNS += ("tick_ms", "cause", "reason")


def row(controller, level, twin, tied, cause="", reported="", tick="", fault="", planning=5.0):
    seconds, reason = 24.0 + twin, "every step was executed"
    ticks = ("", "", tick, tick)
    told = (tied, reported, 3, 12.5, seconds, planning, *ticks, cause, reason)
    return (controller, level, twin, "overhand", fault, *told)


def executions():
    yield from (row("open_loop", 1, twin, twin < 6, "" if twin < 6 else "out of the DAG")
                for twin in range(10))  # fmt: skip
    for twin in range(8):  # on fewer twins: only these are compared
        seen = {"reported": "yes", "cause": "" if twin else "state misread"}
        yield row("replan", 1, twin, bool(twin), **seen)


def executions_of_parts():
    yield row("mppi_true_state", 2, 0, True, tick=52.0)
    yield row("replan_true_state", 1, 0, True, reported="yes")
    yield row("open_loop_robust", 1, 1, True, planning=11.0)
    yield row("replan", 1, 0, True, reported="yes", fault="rope dropped")
    yield row("replan", 1, 1, False, "rope not seen", reported="no", fault="rope dropped")


def test_the_difference_is_of_the_same_twins(write):
    write.table("closed_loop", "executions.csv", COLUMNS, executions())
    write.table("closed_loop_ablation", "executions.csv", COLUMNS, executions_of_parts())
    found = closed_loop.values(Results(write.root), Pictures())
    (line,) = [one for one in found["table"].splitlines() if "planned anew |" in one]
    # Seven of eight against six of the same eight: twins 6 and 7 gained, twin 0 lost.
    assert "7 of 8" in line and "| 12.5 (" in line
    assert "| −100 |" in line  # twin 0 by the true state
    assert (found["looked"], found["reported"], found["apart"]) == (11, 1, False)
    assert found["missing"] == "MPPI and MPPI, planned anew"
    causes = found["causes"].splitlines()
    assert causes[0] == "| knot | level | executed | not tied | out of the DAG | state misread |"
    assert len(causes) == 4


def test_time_robust_plans_and_faults_have_tables_of_their_own(write):
    write.table("closed_loop", "executions.csv", COLUMNS, executions())
    assert closed_loop.parts(Results(write.root), Pictures()) is None
    write.table("closed_loop_ablation", "executions.csv", COLUMNS, executions_of_parts())
    found = closed_loop.values(Results(write.root), Pictures())
    assert found["ticks"].splitlines()[2] == "| MPPI, true state | – | – | 52 ms | 52 ms |"
    found = closed_loop.parts(Results(write.root), Pictures())
    assert found["robust"].splitlines()[2] == "| 1 | 5.0 s | 11 s | 6.0 | 0.0 |"
    (line,) = found["faults"].splitlines()[2:]
    assert line == "| rope dropped | planned anew | 2 | 1 | 1 | 0 | rope not seen 1 |"


def test_what_was_configured_otherwise_is_not_compared(write):
    for name, rows, margin in (
        ("closed_loop", executions(), 0.05),
        ("closed_loop_ablation", executions_of_parts(), 0.0),
    ):
        write.table(name, "executions.csv", COLUMNS, rows)
        config = {"cases": [name], "planner": {"margin": margin}}
        stages = {"stages": {"executions": {"config": config}}}
        (write.root / name / "config.yaml").write_text(yaml.safe_dump(stages))
    found = closed_loop.values(Results(write.root), Pictures())
    assert found["apart"] and "true state" not in found["table"] and found["looked"] == 8
    found = closed_loop.parts(Results(write.root), Pictures())
    assert found["robust"] == "" and "open loop, robust plan" in found["table"]
    text = compose(Results(write.root), "results").markdown
    assert text.count("configured otherwise") == 2 and "stand in the table" not in text


def test_the_section_shows_figure_tables_and_limits(write):
    write.table("closed_loop", "executions.csv", COLUMNS, executions())
    write.table("closed_loop_ablation", "executions.csv", COLUMNS, executions_of_parts())
    text = compose(Results(write.root), "results").markdown
    assert "figures/executions.png" in text
    assert "1\nreported a knot that is not there" in text
    assert "| rope dropped | planned anew |" in text
    assert "What simulation cannot say" in text


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (row("magic", 1, 0, True), "column 'controller', row 1"),
        (row("replan", 1, 0, True, "grasp missed"), "column 'cause', row 1"),
    ],
)
def test_a_table_that_contradicts_itself_is_refused(write, wrong, told):
    write.table("closed_loop", "executions.csv", COLUMNS, [wrong])
    with pytest.raises(ResultsError, match=told):
        closed_loop.values(Results(write.root), Pictures())


def test_errors_of_models_stand_side_by_side(write):
    columns = ("model", "level", "steps", "motions", "mean_error_mm")
    rows = [(model, level, steps, 20, 10.0 * level + steps)
            for model in ("mujoco", "still") for level in (0, 1) for steps in (1, 10)]  # fmt: skip
    write.table("dynamics", "errors.csv", columns, rows)
    found = dynamics.values(Results(write.root), Pictures())
    lines = found["table"].splitlines()
    assert lines[0] == "| level | model | after 0.1 s | after 1 s |"
    assert lines[2] == "| 0 | standing still | 1.0 mm | 10.0 mm |"
    assert lines[3] == "| 0 | bidirectional LSTM | – | – |"
    assert found["motions"] == 40
