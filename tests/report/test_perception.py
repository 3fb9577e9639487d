"""The sections of perception and tracking tell what is in their tables."""

import pandas as pd
import pytest

from knotflow.report import perception, tracking
from knotflow.report.results import Results
from knotflow.report.section import Pictures


@pytest.fixture
def results(tmp_path):
    rows = [
        {
            "method": method, "noise": noise, "crossings": crossings, "rope": rope,
            "mean_error_mm": 2.0 + rope, "p95_error_mm": 4.0, "off_curve_error_mm": 1.0,
            "state_correct": int(rope != 2), "head_correct": 1, "doubtful": int(rope == 2),
            "rope_iou": 0.9, "seconds": 3.0,
        }
        for method in ("rendering", "rendering_poor_start")
        for noise in (0.0, 1.0) for crossings in (0, 3, 5) for rope in range(3)
    ]  # fmt: skip
    (tmp_path / "perception").mkdir()
    pd.DataFrame(rows).to_csv(tmp_path / "perception" / "estimates.csv", index=False)
    rows = [
        {
            "method": method, "level": level, "action": "R1_0_1_1", "rollout": f"{level}-{number}",
            "frame": frame, "mean_error_mm": error + frame + number, "visible_share": 0.9,
            "state_correct": int(number > 0), "lost": int(frame == 1 and number == 0),
            "moving": int(frame < 3), "seconds": 0.1,
        }
        for method, error in (("rendering_mujoco", 1.0), ("point_drift", 5.0))
        for level in (0, 1) for number in range(3) for frame in range(4)
    ]  # fmt: skip
    (tmp_path / "tracking").mkdir()
    pd.DataFrame(rows).to_csv(tmp_path / "tracking" / "tracks.csv", index=False)
    return Results(tmp_path)


def test_estimates_are_told_by_method_noise_and_crossings(results):
    told = perception.values(results, Pictures())
    lines = told["table"].splitlines()[2:]
    assert len(lines) == 2 * 2 * 2 + len(perception.METHODS) - 2
    assert "| skeleton and rendering | 1 | 0 to 3 | 6 | 3.0" in told["table"]
    assert "2 of 2" in lines[0] and "66.7 %" in lines[0]
    assert told["figure"]


def test_it_is_said_how_often_estimates_without_a_doubt_are_right(results):
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path)
    wrong = (table["rope"] == 1) & (table["noise"] == 1)
    table.loc[wrong, "state_correct"] = 0
    table.to_csv(path, index=False)
    perfect, nominal = perception.values(Results(results.root), Pictures())["sure"]
    assert [perfect[name] for name in ("noise", "ropes", "sure")] == ["0", 9, 6]
    assert perfect["right"].startswith("100") and nominal["right"].startswith("50.0 %")


def test_plans_from_estimates_are_held_against_those_from_true_ropes(results):
    rows = [
        {
            "rope": f"{rope:03d}", "planned_from": planned_from, "planned": 1, "branches": 3,
            "tied": int(planned_from == "true" or rope > 0), "seconds": 2.0, "mean_error_mm": 1.0,
        }
        for rope in range(4) for planned_from in ("true", "estimated")
    ]  # fmt: skip
    assert perception.values(results, Pictures())["plans"] is None
    pd.DataFrame(rows).to_csv(results.root / "perception" / "plans.csv", index=False)
    plans = perception.values(Results(results.root), Pictures())["plans"]
    assert plans["true"]["tied"].startswith("100") and plans["estimated"]["tied"].startswith("75")


def test_methods_whose_network_was_not_there_are_not_run(results):
    told = perception.values(results, Pictures())
    assert told["without_network"] and told["shown"] == "skeleton and rendering"
    assert "| network alone | not run |" in told["table"]
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path).replace("rendering_poor_start", "network")
    table.to_csv(path, index=False)
    told = perception.values(Results(results.root), Pictures())
    assert not told["without_network"]
    assert "| network alone | 1 | 0 to 3 |" in told["table"]
    assert "| rendering from a poor start | not run |" in told["table"]


def test_a_rope_that_was_not_found_has_no_error(results):
    path = results.root / "perception" / "estimates.csv"
    table = pd.read_csv(path)
    table.loc[0, ["mean_error_mm", "p95_error_mm", "off_curve_error_mm"]] = None
    table.to_csv(path, index=False)
    assert perception.values(results, Pictures())["table"]


def test_tracks_are_told_by_method_and_level_and_held_against_the_yardstick(results):
    told = tracking.values(results, Pictures())
    assert told["difference"].startswith("−4.0")
    first = told["table"].splitlines()[2]
    assert "| rendering mujoco | 0 | 3 | 3.0" in first and "66.7 %" in first and "100 ms" in first
    assert "8.3 %" in first  # one image of twelve


def test_what_the_cameras_place_alone_moves_is_a_line_without_motion_or_time(results):
    assert not tracking.values(results, Pictures())["misplaced"]
    path = results.root / "tracking" / "tracks.csv"
    tracks = pd.read_csv(path)
    alone = tracks.iloc[:1].assign(
        method="camera_misplaced", frame=9, mean_error_mm=3.5, moving=0, seconds=0.0
    )
    pd.concat([tracks, alone]).to_csv(path, index=False)
    told = tracking.values(Results(results.root), Pictures())
    (line,) = (line for line in told["table"].splitlines() if "camera misplaced" in line)
    assert told["misplaced"] and "| – | 3.5" in line and line.endswith("– |")


def test_what_was_not_run_has_no_section(tmp_path):
    assert perception.values(Results(tmp_path), Pictures()) is None
    assert tracking.values(Results(tmp_path), Pictures()) is None
