"""Executions are compared on the same twins, and each failure has a cause; arm trajectories."""

import pytest

from knotflow.report.results import ResultsError

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
    yield row("mppi", 2, 0, True, tick=52.0)
    yield row("replan", 1, 0, True, reported="yes")
    yield row("replan_true_state", 1, 0, True, reported="yes")  # of an older result
    yield row("open_loop_robust", 1, 1, True, planning=11.0)
    yield row("replan", 1, 0, True, reported="yes", fault="rope dropped")
    yield row("replan", 1, 1, False, "rope not seen", reported="no", fault="rope dropped")


def test_difference_is_of_the_same_twins(write):
    write.table("closed_loop", "executions.csv", COLUMNS, executions())
    text = write.body("closed_loop")
    (line,) = [one for one in text.splitlines() if "| replanning | 87" in one]
    # Seven of eight against six of the same eight: twins 6 and 7 gained, twin 0 lost.
    assert "7 of 8" in line and "| 12.5 (" in line
    assert "1 of 8 executions that ended with a look" in text
    header = "| knot | level | controller | not tied | out of the DAG | state misread |"
    assert header in text and "(figures/executions.png)" in text


def test_ablation_is_compared_with_closed_loop(write):
    assert write.body("closed_loop_ablation") is None
    write.table("closed_loop", "executions.csv", COLUMNS, executions())
    write.table("closed_loop_ablation", "executions.csv", COLUMNS, executions_of_parts())
    text = write.body("closed_loop_ablation")
    assert "| MPPI | – | – | 52 ms | 52 ms |" in text
    (line,) = [one for one in text.splitlines() if "| replanning | 100" in one]
    assert "| 0.0 " in line  # twin 0, which open loop tied too
    assert "| rope dropped | replanning | 2 | 1 | 1 | 0 | rope not seen 1 |" in text
    assert "robust" not in text and "true state" not in text


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        (row("replan", 1, 0, True, "grasp missed"), "tied, and failed by grasp missed"),
        (row("replan", "one", 0, True), "level is 'one'"),
    ],
)
def test_contradictory_table_is_refused(write, wrong, problem):
    write.table("closed_loop", "executions.csv", COLUMNS, [wrong])
    with pytest.raises(ResultsError, match=problem):
        write.body("closed_loop")


ARM = ("arm", "plan", "knot", "solved", "reachable", "tied_as_exported", "simulated")
ARM += ("out_of_reach", "planning_seconds", "waypoints", "unreached", "tip_error_mm", "tip_speed")
ARM += ("limit_margin_deg", "joint_speed_share", "seconds", "slowed")
FOUND = [
    (0, "overhand", True, True, True, 24, 0, 9.0, 400, 0, 0.4, 0.249, 8.1, 0.5, 40.0, 1.01),
    (1, "overhand", True, True, False, 36, 3, 21.0, 600, 0, 0.7, 0.25, 2.0, 0.9, 60.0, 1.05),
    (2, "overhand", False, False, False, 400, 90, 300.0, *[""] * 8),
]


def test_arm_trajectories_are_of_the_plans_that_were_found(write):
    table = [(arm, *row) for arm, rows in (("panda", FOUND), ("mine", FOUND[2:])) for row in rows]
    write.table("arm", "trajectories.csv", ARM, table)
    text = write.body("arm")
    assert "4 searches within reach" in text and "| panda | mine |" in text
    for part in ("2 of 3", "0 of 1", "1 of 2", "0.70 mm", "0.250 m/s", "2.0°", "90 %", "50 s"):
        assert part in text
    assert "1.03 times | – |" in text
