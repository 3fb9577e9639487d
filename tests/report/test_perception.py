"""The sections of perception and tracking tell what is in their tables."""

import pandas as pd
import pytest

from knotflow.execution import CONTROLLERS
from knotflow.experiments.perception import METHODS
from knotflow.report import execution, perception


@pytest.fixture
def results(write):
    rows = [
        {
            "method": method, "noise": noise, "crossings": crossings, "rope": rope,
            "mean_error_mm": 2.0 + rope, "off_curve_error_mm": 1.0,
            "state_correct": int(rope != 2), "head_correct": 1, "doubtful": int(rope == 2),
            "diameter_mm": (4.0, 10.0, 25.0)[rope], "seconds": 3.0,
        }
        for method in ("network_rendering", "full")
        for noise in (0.0, 1.0) for crossings in (0, 3, 5) for rope in range(3)
    ]  # fmt: skip
    write.table("perception", "estimates.csv", [*rows[0]], [[*row.values()] for row in rows])
    rows = [
        {
            "method": method, "level": level, "action": "R1_0_1_1", "rollout": f"{level}-{number}",
            "frame": frame, "mean_error_mm": error + frame + number,
            "state_correct": int(number > 0), "lost": int(frame == 1 and number == 0),
            "moving": int(frame < 3), "seconds": 0.1,
        }
        for method, error in (("rendering_mujoco", 1.0), ("rendering_lstm", 5.0))
        for level in (0, 1) for number in range(3) for frame in range(4)
    ]  # fmt: skip
    write.table("tracking", "tracks.csv", [*rows[0]], [[*row.values()] for row in rows])
    return write


def test_estimates_by_method_noise_and_crossings(results):
    text = results.body("perception")
    lines = [line for line in text.splitlines() if line.startswith("| ")][2:]
    assert len(lines) == 2 * 2 * 2
    assert "| network + rendering | 0 | 0 to 3 | 6 | 3.0" in lines[0]
    assert "2 of 2" in lines[0] and "66.7 %" in lines[0]


def test_the_complete_method_has_a_line_of_the_ropes_that_ablations_see(results):
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path)
    some = table[(table["method"] == "full") & (table["noise"] == 1) & (table["rope"] < 2)]
    pd.concat([table, some.assign(method="full_without_colour")]).to_csv(path, index=False)
    lines = results.body("perception").splitlines()
    (line, more) = (one for one in lines if one.startswith("| complete, on these ropes | 1 |"))
    assert "| 0 to 3 | 4 | 2.5" in line and "| 4 of 4 |" in line and "| 5 to 5 | 2 |" in more


def test_accuracy_of_unambiguous_estimates(results):
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path)
    table.loc[(table["rope"] == 1) & (table["noise"] == 1), "state_correct"] = 0
    table.to_csv(path, index=False)
    text = results.body("perception")
    assert "at noise 0 (6 of 9 ropes) and 50.0 % (" in text
    assert "by the complete method is 100.0 % (" in text


def test_accuracy_by_diameter(results):
    text = results.body("perception")
    assert "by diameter is 100.0 % (61.0 to 100.0) for 4 to 8 mm, 100.0 %" in text
    assert "0.0 % (0.0 to 39.0) for 14 to 25 mm" in text


def test_plans_from_estimates_and_from_true_ropes(results):
    rows = [
        {
            "rope": f"{rope:03d}", "planned_from": planned_from, "planned": 1, "simulated": 3,
            "tied": int(planned_from == "true" or rope > 0), "seconds": 2.0, "mean_error_mm": 1.0,
        }
        for rope in range(4) for planned_from in ("true", "estimated")
    ]  # fmt: skip
    assert "Plans for the overhand" not in results.body("perception")
    pd.DataFrame(rows).to_csv(results.root / "perception" / "plans.csv", index=False)
    text = results.body("perception")
    assert "from estimated shapes, 100.0 % (51.0 to 100.0) of 4 random ropes" in text
    assert "a plan and 75.0 % (" in text


def test_every_method_and_controller_is_shown():
    assert {*METHODS} == perception.METHODS.keys()
    assert CONTROLLERS.keys() == execution.CONTROLLERS.keys()


@pytest.mark.slow
def test_older_methods_are_not_shown(results):
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path)
    other = table[table["method"] == "network_rendering"].assign(method="rendering_poor_start")
    pd.concat([table, other]).to_csv(path, index=False)
    text = results.body("perception")
    assert "| complete | 1 | 0 to 3 |" in text and "poor" not in text


def test_ablations_are_compared_on_the_same_ropes(results):
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path)
    table = table[(table["method"] == "full") | (table["rope"] > 0)]
    table.to_csv(path, index=False)
    lines = results.body("perception").splitlines()
    (line,) = [one for one in lines if one.startswith("| network + rendering | 1 | 0 to 3 |")]
    assert "| 4 |" in line and "| 2 of 4 |" in line
    (line,) = [one for one in lines if one.startswith("| complete | 1 | 0 to 3 |")]
    assert "| 6 |" in line and "| 4 of 6 |" in line


@pytest.mark.slow
def test_older_trackers_are_not_shown(results):
    path = results.root / "tracking" / "tracks.csv"
    pd.read_csv(path).replace("rendering_lstm", "point_drift").to_csv(path, index=False)
    text = results.body("tracking")
    assert "| MuJoCo | 0 |" in text and "drift" not in text


def test_rope_that_was_not_found_has_no_error(results):
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path)
    table.loc[0, ["mean_error_mm", "off_curve_error_mm"]] = None
    table.to_csv(path, index=False)
    assert results.body("perception")


def test_tracks_by_method_and_level(results):
    text = results.body("tracking")
    (line,) = (one for one in text.splitlines() if one.startswith("| MuJoCo | 0 |"))
    assert "| 3 | 3.0" in line and "66.7 %" in line and "100 ms" in line
    assert "8.3 %" in line  # one image of twelve


def test_calibration_error_is_a_line_without_motion_or_time(results):
    path = results.root / "tracking" / "tracks.csv"
    tracks = pd.read_csv(path)
    alone = tracks.iloc[:1].assign(
        method="camera_misplaced", frame=9, mean_error_mm=3.5, moving=0, seconds=0.0
    )
    pd.concat([tracks, alone]).to_csv(path, index=False)
    text = results.body("tracking")
    (line,) = (one for one in text.splitlines() if "| calibration error" in one)
    assert "| – | 3.5" in line and line.endswith("– |")


def test_models_of_the_dynamics_stand_side_by_side(write):
    columns = ("model", "level", "steps", "motions", "mean_error_mm")
    rows = [
        (model, level, steps, 20, 10.0 * level + steps)
        for model in ("mujoco", "still")
        for level in (0, 1)
        for steps in (1, 10)
    ]
    write.table("dynamics", "errors.csv", columns, rows)
    lines = write.body("dynamics").splitlines()[2:]
    assert lines[0] == "| level | model | after 0.1 s, mm | after 1 s, mm |"
    assert lines[2] == "| 0 | static | 1.0 | 10.0 |"
    assert lines[3] == "| 0 | bidirectional LSTM | – | – |"
    assert "over 40 motions" in lines[-1]


def test_nothing_run_is_nothing_shown(write):
    for section in ("perception", "tracking", "dynamics"):
        assert write.body(section) is None
