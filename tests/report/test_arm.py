"""What an arm does with plans is summed up over those that were found."""

from knotflow.report import arm
from knotflow.report.page import compose
from knotflow.report.results import Results
from knotflow.report.section import Pictures

COLUMNS = ("plan", "knot", "solved", "waypoints", "unreached", "tip_error_mm", "tip_speed")
COLUMNS += ("limit_margin_deg", "joint_speed_share", "seconds", "slowed")
ROWS = [
    (0, "overhand", True, 400, 0, 0.4, 0.249, 8.1, 0.5, 40.0, 3.0),
    (1, "overhand", True, 600, 6, 0.7, 0.25, 2.0, 0.9, 60.0, 4.0),
    (2, "overhand", False, *[""] * 8),
]


def test_extremes_are_of_all_plans_that_were_found(write):
    write.table("arm", "trajectories.csv", COLUMNS, ROWS)
    found = arm.values(Results(write.root), Pictures())
    assert (found["plans"], found["found"]) == (3, 2)
    told = found["table"]
    for part in ("1 of 2", "99.40 %", "0.70 mm", "0.250 m/s", "2.0°", "90%", "50 s", "3.5 times"):
        assert part in told
    assert "Of 3 searches, 2 found a plan" in compose(Results(write.root), "results").markdown


def test_without_a_plan_there_is_no_table(write):
    write.table("arm", "trajectories.csv", COLUMNS, ROWS[2:])
    assert arm.values(Results(write.root), Pictures())["table"] == ""
