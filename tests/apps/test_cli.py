"""The `knotflow` command, as people type it."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from tests.perception.photographs import centre_line, photograph

from knotflow.apps import lab, outputs, search
from knotflow.apps.cli import main
from knotflow.perception import Camera
from knotflow.planning import KnotPlan, PlannerConfig, parse_rope, plan_rope
from knotflow.samplers.demonstrations import load_demonstrations, save_demonstrations
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeConfig
from knotflow.viz import plan_folder

LOOP = "R1(0,1,1)"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def found():
    """A plan for a loop, of few branches."""
    rng = np.random.default_rng(0)
    plan = plan_rope(
        parse_rope("straight", RopeConfig(), rng), LOOP, rng,
        sampler=build_sampler(SamplerConfig("aimed"), {}),
        config=PlannerConfig(batch=8, max_branches=64),
    )  # fmt: skip
    assert plan.solved
    return plan


@pytest.fixture
def searches(monkeypatch, found):
    """Makes the command find that plan at once; lists the arguments of every search."""
    asked = []

    def find_plan(knot, measured, earlier=None, **options):
        asked.append({"measured": measured, "earlier": earlier} | options)
        return replace(found, worlds=16, survived=(15,)), None

    def write(folder, plan, source, rope, *, request, **_):
        (folder / "plan.json").write_text(plan.to_json())
        outcome = {"success": plan.solved, "text": plan.summary()}
        (folder / "outcome.json").write_text(json.dumps(outcome))
        (folder / "request.json").write_text(json.dumps(request))

    monkeypatch.setattr(search, "find_plan", find_plan)
    monkeypatch.setattr(plan_folder, "write_plan_folder", write)
    return asked


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["plan"], "KNOT"),
        (["pln", "overhand"], 'Did you mean "plan"'),
        (["plan", "overhnd"], "unknown knot 'overhnd'; write a knot's name"),
        (["plan", "overhand", "--rop", "straight"], "Did you mean --rope?"),
        (["plan", "overhand", "--rope", "strait"], "unknown rope 'strait': give one of straight"),
        (["plan", "overhand", "--rope", "none.csv"], "there is no such rope file"),
        (["plan", "overhand", "--rope-unit", "km"], "Choose from"),
        (["plan", "overhand", "--diameter", "6in"], "--diameter '6in' is no length: write 6mm"),
        (["plan", "overhand", "--stiffness", "hard"], "--stiffness soft, medium, stiff or"),
        (["plan", "overhand", "--stiffness", "hard"], "such as 4cm, not 'hard'"),
        (["plan", "overhand", "--length", "0.1", "--diameter", "1cm"], "a twentieth of the rope"),
        (["plan", "overhand", "--seed", "-1"], "--seed"),
        (["plan", "overhand", "--seed", "one"], "--seed"),
        (["plan", "overhand", "--max-seconds", "0"], "--max-seconds"),
        (["plan", "overhand", "--margin", "-0.01"], "--margin"),
        (["plan", "overhand", "--margin", "15cm"], "leave 7 pieces of rope, of 1 m at most 0.14 m"),
        (["run", "overhand", "--yes", "--margin", "15cm"], "leave 7 pieces of rope"),
        (["plan", "overhand", "--length", "8m"], "by 80 mm: the fingers grasp 46 mm at most"),
        (["run", "overhand", "--yes", "--diameter", "48mm"], "the fingers grasp 46 mm at most"),
        (["plan", "overhand", "--stiffness", "30cm"], "is not between 0.002 and 0.15 m"),
        (["plan", "overhand", "--arm", "pnda"], "give panda, ur5e, xarm7"),
        (["run", "overhand", "--yes", "--arm", "pnda"], "give panda, ur5e, xarm7"),
        (["run", "overhand", "--yes", "--arm", "panda", "--base", "no.yaml"], "no.yaml"),
        (["run", "overhand", "--yes", "--robot", "a:B", "--level", "0"], "the simulated robot"),
        (["plan", "unknot"], "nothing to plan"),
        (["plan", "overhand", "--out", "/proc/1/plan"], "/proc/1"),
        (["next", "overhand"], "--rope"),
        (["run", "overhand"], "run asks before every action: use a terminal, or --yes"),
        (["run", "overhand", "--yes", "--robot", "a:B"], "--camera FILE, with its pose"),
        (["run", "overhand", "--yes", "--camera", "c.yaml"], "not for the simulated robot"),
        (["knots", "--out", "knots.doc"], ".png, .svg or .pdf"),
        (["explain", "overhnd"], "cannot explain 'overhnd': give a knot (unknot, overhand"),
        (["explain", "C(0,9,1)"], "there is no segment 9"),
        (["explain", "C(0,1)"], "C(0,1)"),
        (["explain", "overhand", "--state", "2o1+"], "--state is for an action"),
        (["explain", "3o1-"], "each position from 1 to 2 once"),
        (["explain", "--out", "picture.doc"], ".png, .svg or .pdf"),
        (["view", "none.mcap"], "none.mcap"),
        (["see", "a.png", "b.png", "--out", "r.csv"], "--camera"),
        (["see", "a.png", "b.png", "--camera", "no.yaml", "--out", "r.csv"], "no.yaml: cannot be"),
        (["see", "a.png", "--depth-unit", "mm"], "--depth-unit is of a depth image"),
        (["see", "a.png", "--diameter", "6mm"], "--diameter is not for a photograph"),
        (["next", "overhand", "--rope", "arc", "--depth-unit", "mm"], "is of a depth image"),
        (["next", "overhand", "--rope", "arc", "--head-color", "red"], "are of an image"),
        (["plan", "overhand", "--tip", "hand"], "--base and --tip need --arm"),
        (["next", "overhand", "--rope", "arc", "--base", "b.yaml"], "need --arm"),
        (["report", "--results", "nowhere"], "there is no such results folder"),
    ],
)
def test_wrong_input_is_2_with_the_cure_and_leaves_nothing(words, message, here, capsys):
    assert main(words) == 2
    told = capsys.readouterr()
    said = " ".join((told.out + told.err).replace("│", " ").split())
    assert message in said
    assert not list(here.iterdir())


def test_help_is_one_screen_with_examples_and_loads_nothing_heavy(here):
    code = "import sys; from knotflow.apps.cli import main; main(sys.argv[1:]); print(*sys.modules)"
    for words in (["--help"], ["plan", "--help"], ["plan", "--sed", "3"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True
        )
        *shown, modules = done.stdout.splitlines()
        assert not {"numpy", "torch", "mujoco", "matplotlib", "pandas"} & set(modules.split())
        assert len(shown) < 40
        assert max(map(len, shown), default=0) <= 80
        if words == ["--help"]:
            assert any("knotflow plan figure_eight --rope measured.csv" in line for line in shown)


def test_version(capsys):
    assert main(["--version"]) == 0
    assert re.fullmatch(r"knotflow \d+\.\d+\.\d+\n", capsys.readouterr().out)


def test_the_same_plan_is_told_again_and_another_takes_no_place(searches, here, capsys):
    words = ["plan", LOOP, "--rope", "straight"]
    assert main(words) == 0
    (folder,) = (here / "plans").iterdir()
    assert "tied (the goal was reached)" in capsys.readouterr().out
    first = (folder / "request.json").read_bytes()
    assert main(words) == 0
    assert "already planned; --overwrite" in capsys.readouterr().out
    outcome = (folder / "outcome.json").read_text()
    (folder / "outcome.json").write_text("{}")
    assert main(words) == 2
    assert "outcome.json is damaged; --overwrite" in capsys.readouterr().err
    (folder / "outcome.json").write_text(outcome)
    assert len(searches) == 1
    assert main([*words, "--max-seconds", "5"]) == 2
    told = capsys.readouterr().err
    assert "max_seconds 60.0 there and 5.0 here" in told
    assert "--overwrite" in told and "--out" in told
    assert (folder / "request.json").read_bytes() == first
    assert main([*words, "--max-seconds", "5", "--overwrite"]) == 0
    assert json.loads((folder / "request.json").read_text())["max_seconds"] == 5.0
    assert len(searches) == 2
    assert [path.name for path in (here / "plans").iterdir()] == [folder.name]


def test_plan_has_the_size_and_frame_of_the_rope(searches, found, here, capsys):
    line = np.column_stack([np.linspace(1000, 3000, 30), np.full(30, 500), np.full(30, 80)])
    np.savetxt(here / "mine.csv", line, delimiter=",", header="x [mm],y,z", comments="")
    words = [LOOP, "--rope", "mine.csv", "--diameter", "16mm", "--stiffness", "5cm"]
    assert main(["plan", *words]) == 0
    assert "rope of 2 m by 16 mm, bending length 5 cm" in capsys.readouterr().out
    (asked,) = searches
    measured = asked["measured"]
    assert measured.model.radius == pytest.approx(0.004)
    (path,) = here.glob("plans/*/plan.json")
    plan = KnotPlan.from_json(path.read_text())
    assert (plan.frame.unit, plan.frame.height) == ("mm", pytest.approx(0.072))
    np.testing.assert_allclose(plan.start[:, :2], 2 * found.start[:, :2] + [2.0, 0.5])
    np.testing.assert_allclose(plan.splines[:, 3], 2 * found.splines[:, 3])
    assert plan.steps[0].release_time == pytest.approx(found.steps[0].release_time * 2**0.5)
    plan.waypoints().to_csv(here / "waypoints.csv", plan.frame)
    header, *rows = (here / "waypoints.csv").read_text().splitlines()
    assert header.startswith("time_s,x_mm,y_mm,z_mm,")
    down = next(row.split(",") for row in rows if row.endswith("close"))
    grasp = plan.controls[0, 0] * 1000 + [0, 0, 72]
    np.testing.assert_allclose([float(cell) for cell in down[1:4]], grasp, atol=0.5)


def test_a_folder_that_is_no_plan_is_never_replaced(searches, here, capsys):
    (here / "thesis").mkdir()
    (here / "thesis" / "chapter.tex").write_text("years of work")
    assert main(["plan", LOOP, "--rope", "straight", "--out", "thesis", "--overwrite"]) == 2
    assert "holds files, but no plan" in capsys.readouterr().err
    assert os.listdir(here / "thesis") == ["chapter.tex"]
    assert not searches


def test_files_of_one_name_have_plans_of_their_own(searches, here):
    for name, bend in (("one", 0.5), ("two", 0.8)):
        angle = np.linspace(-bend, bend, 20)
        curve = np.column_stack([np.sin(angle), np.cos(angle) - 0.9, 0 * angle]) * 0.5 / bend
        (here / name).mkdir()
        np.savetxt(here / name / "measured.csv", curve, delimiter=",")
        assert main(["plan", LOOP, "--rope", f"{name}/measured.csv"]) == 0
    assert len(list((here / "plans").iterdir())) == len(searches) == 2


def test_a_search_that_fails_is_1_and_its_folder_says_so(searches, found, here, monkeypatch):
    failed = replace(found, solved=False, steps=(), reason="0.1 s passed")
    monkeypatch.setattr(search, "find_plan", lambda *_, **__: (failed, None))
    for _ in range(2):  # the second time it is told what was found before
        assert main(["plan", LOOP, "--rope", "straight"]) == 1
    assert not json.loads(next(here.glob("plans/*/outcome.json")).read_text())["success"]


def test_a_plan_less_sure_than_sought_says_so(found, searches, monkeypatch, capsys):
    words = ["plan", LOOP, "--rope", "straight", "--margin", "2cm", "--overwrite"]
    assert main(words) == 0
    assert searches.pop()["margin"] == 0.02
    assert "sought" not in capsys.readouterr().out
    unsure = replace(found, worlds=16, survived=(11,)), None
    monkeypatch.setattr(search, "find_plan", lambda *_, **__: unsure)
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "in fewer than the 75 % sought; longer: --overwrite --max-seconds 120" in told
    assert "--margin 0.01" in told
    assert main(words[:-1]) == 0
    told = capsys.readouterr().out
    assert "already planned" in told and "in fewer than the 75 % sought" in told


def test_a_stopped_search_is_not_what_was_asked_for(found, searches, monkeypatch):
    words = ["plan", LOOP, "--rope", "straight"]
    stopped = replace(found, reason="the search was stopped"), None
    monkeypatch.setattr(search, "find_plan", lambda *_, **__: stopped)
    assert main(words) == 0
    assert main(words) == 2
    assert main([*words, "--overwrite"]) == 0


def test_next_of_a_tied_rope_is_done(found, here, searches, capsys):
    np.savetxt(here / "tied.csv", found.steps[-1].end, delimiter=",")
    assert main(["next", LOOP, "--rope", "tied.csv"]) == 0
    assert "tied: the rope is in the state" in capsys.readouterr().out
    assert not searches


@pytest.mark.slow
def test_the_next_action_says_what_how_sure_and_what_to_check(searches, here, capsys):
    assert main(["next", LOOP, "--rope", "straight", "--out", "step.csv"]) == 0
    told = capsys.readouterr().out
    assert "twist a loop into the rope (segment 0)" in told
    assert "the rope must then be in the state 2o1+" in told
    assert "success  in 15 of 16 worlds, of the whole plan in 15" in told
    assert (here / "step.csv").read_text().startswith("time_s,")
    (asked,) = searches
    assert (asked["margin"], asked["worlds"], asked["error"]) == (0.03, 16, 0.005)
    assert main(["next", LOOP, "--rope", "straight", "--length", "0.2m"]) == 0
    assert searches.pop()["margin"] == pytest.approx(0.006)
    assert main(["next", LOOP, "--rope", "straight", "--out", "step.csv"]) == 2


def test_a_next_action_that_is_not_found_is_1_and_says_what_to_try(found, monkeypatch, capsys):
    failed = replace(found, solved=False, steps=(), reason="60 s passed")
    monkeypatch.setattr(search, "find_plan", lambda *_, **__: (failed, None))
    assert main(["next", LOOP, "--rope", "straight"]) == 1
    told = capsys.readouterr().out
    assert "60 s passed" in told and "--max-seconds 120" in told and "--margin 0.015" in told


def test_the_next_action_goes_on_with_the_plan_that_is_kept(searches, found, here, capsys):
    rope = here / "rope.csv"
    np.savetxt(rope, 0.7 * found.start + [0.3, 0.1, 0.0], delimiter=",")
    for _ in range(2):
        assert main(["next", LOOP, "--rope", str(rope), "--plan", "kept/loop.json"]) == 0
    first, second = (search["earlier"] for search in searches)
    assert first is None
    # On the model's scale, wherever it was: splines are carried to where the rope lies.
    shift = (second.steps[0].start - found.start).mean(axis=0)
    np.testing.assert_allclose(second.steps[0].start, found.start + shift, atol=2e-3)
    expected = found.splines + [0.0, shift[0], shift[1], 0.0, shift[0], shift[1]]
    np.testing.assert_allclose(second.splines, expected, atol=2e-3)
    kept = KnotPlan.from_json((here / "kept" / "loop.json").read_text())
    assert kept.radius == pytest.approx(0.7 * found.radius, rel=1e-2)

    capsys.readouterr()
    assert main(["next", "overhand", "--rope", str(rope), "--plan", "kept/loop.json"]) == 2
    assert f"keeps a plan for {LOOP}: name another file" in capsys.readouterr().err
    (here / "other.json").write_text("{}")
    assert main(["next", LOOP, "--rope", str(rope), "--plan", "other.json"]) == 2
    assert "the plan has no" in capsys.readouterr().err
    assert len(searches) == 2


def test_a_plan_that_cannot_be_kept_is_refused_before_the_search(searches, here, capsys):
    (here / "file").touch()
    assert main(["next", LOOP, "--rope", "straight", "--plan", "file/kept.json"]) == 2
    assert "cannot write file/kept.json" in capsys.readouterr().err
    assert not searches


def test_a_run_goes_on_with_its_last_plan(searches, found, here, monkeypatch):
    def tie(knot, robot, camera, rope, replan, *_):
        plans.extend(replan(found.start) for _ in range(3))
        return lab.Tied(True, "tied")

    plans = []
    monkeypatch.setattr(lab, "tie", tie)
    assert main(["run", LOOP, "--yes"]) == 0
    first, *later = [search["earlier"] for search in searches]
    assert first is None and [one.solved for one in later] == [True, True]
    for plan in later:
        np.testing.assert_array_equal(plan.splines, found.splines)
    assert len(plans) == 3


@pytest.mark.slow
def test_plan_writes_its_folder_and_loads_no_experiment_code(here):
    code = "import sys; from knotflow.apps.cli import main; main(sys.argv[1:]); print(*sys.modules)"
    words = ["plan", LOOP, "--rope", "straight", "--worlds", "0"]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True
    )
    *told, modules = done.stdout.splitlines()
    loaded = {".".join(name.split(".")[:2]) for name in modules.split()}
    assert not {"hydra", "omegaconf", "knotflow.workflow", "knotflow.config"} & loaded
    assert any("tied (the goal was reached)" in line for line in told)
    (folder,) = (here / "plans").iterdir()
    assert {path.name for path in folder.iterdir()} == set(plan_folder.PLAN_FILES)
    plan = KnotPlan.from_json((folder / "plan.json").read_text())
    assert plan.solved
    assert np.diff(plan.steps[0].times).max() == pytest.approx(0.1)


def test_plan_by_other_code_or_weights_is_refused_unless_overwritten(searches, monkeypatch, capsys):
    words = ["plan", LOOP, "--rope", "straight"]
    assert main(words) == 0
    made_by = outputs.provenance()
    monkeypatch.setattr(outputs, "provenance", lambda: made_by | {"primitives": "other"})
    assert main(words) == 2
    assert f"primitives '{made_by['primitives']}' there and 'other' here" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0
    assert len(searches) == 2


def test_overwrite_keeps_other_files(searches, here):
    words = ["plan", LOOP, "--rope", "straight", "--out", "mine"]
    assert main(words) == 0
    (here / "mine" / "panda-joint.csv").write_text("exported")
    (here / "mine" / "plan.gif").write_text("old")
    assert main([*words, "--overwrite"]) == 0
    assert (here / "mine" / "panda-joint.csv").read_text() == "exported"
    assert not (here / "mine" / "plan.gif").exists()


def test_a_rope_that_is_seen_can_be_planned_from(here, capsys, monkeypatch):
    from knotflow.perception import SAMPLE, RopeEstimate, io
    from knotflow.simulation import state_or_none

    truth = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    visible = np.ones(len(truth), bool)
    known = RopeEstimate(truth, visible, state_or_none(truth), (), 1.0, True, ())
    monkeypatch.setattr(io, "estimate", lambda *_, **__: known)
    files = [str(SAMPLE / name) for name in ("overhand.png", "overhand-depth.png", "camera.yaml")]
    words = ["see", *files[:2], "--camera", files[2], "--out", "rope.csv"]
    words += ["--diameter", "16mm"]
    assert main(words) == 0
    assert f"state     {known.state}" in capsys.readouterr().out
    read = parse_rope("rope.csv", RopeConfig(), np.random.default_rng(0))
    assert np.linalg.norm((read - truth)[:, :2], axis=1).max() < 2e-3
    assert (here / "rope.png").stat().st_size > 10_000
    assert main(words) == 2 and "exists already" in capsys.readouterr().err


@pytest.mark.slow
def test_the_next_action_is_planned_from_an_image_unless_it_is_in_doubt(
    searches, here, capsys, monkeypatch
):
    from knotflow.perception import SAMPLE, RopeEstimate, io
    from knotflow.simulation import state_or_none, straight

    points = straight(RopeConfig())
    visible = np.ones(len(points), bool)
    sure = RopeEstimate(points, visible, state_or_none(points), (), 1.0, True, ())
    files = [str(SAMPLE / name) for name in ("overhand.png", "overhand-depth.png", "camera.yaml")]
    words = ["next", LOOP, "--image", *files[:2], "--camera", files[2], "--diameter", "16mm"]
    sizes = []

    def estimate(image, camera, rope, **_):
        sizes.append((rope.length, 2 * rope.radius))
        return sure

    monkeypatch.setattr(io, "estimate", estimate)
    assert main(words) == 0
    assert sizes == [(1.0, 0.016)]
    assert "the rope must then be in the state 2o1+" in capsys.readouterr().out
    monkeypatch.setattr(io, "estimate", lambda *_, **__: replace(sure, ambiguities=("hidden",)))
    assert main(words) == 1
    assert "ambiguous" in capsys.readouterr().out
    assert len(searches) == 1


@pytest.mark.parametrize(
    "words", [[], ["--rope", "arc", "--image", "a.png", "b.png"], ["--image", "a.png", "b.png"]]
)
def test_next_takes_a_rope_or_an_image_with_its_camera(words, capsys):
    assert main(["next", LOOP, *words]) == 2
    assert "either --rope, or --image" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "explain-all.png"),
        (["3o1-2o4-"], "2 crossings, segments 0 to 4"),
        (["C(0,2,-1)", "--state", "3o1-2o4-"], "lay the head (segment 0) over segment 2"),
        (["overhand"], "one of 4 states of overhand"),
        (["R1(0,1,1)", "--out", "loop.svg"], "loop.svg"),
    ],
)
def test_notation_is_drawn_and_said(words, told, here, capsys):
    assert main(["explain", *words]) == 0
    assert told in capsys.readouterr().out
    (picture,) = here.iterdir()
    assert picture.stat().st_size > 5000


def test_a_picture_replaces_no_file_that_was_named(here):
    (here / "mine.png").write_text("a photo")
    assert main(["explain", "--out", "mine.png"]) == 2
    assert (here / "mine.png").read_text() == "a photo"


@pytest.mark.slow
def test_a_length_that_the_pose_contradicts_is_refused(here, capsys):
    line = centre_line("loop", (240, 320))
    Image.fromarray(photograph(line, [True], (240, 320))).save(here / "photo.png")
    Camera.overhead(320, 240, distance=0.8).save(here / "camera.yaml")
    words = ["see", "photo.png", "--camera", "camera.yaml", "--out", "rope.csv"]
    assert main([*words, "--length", "9m"]) == 2
    assert "by the camera's pose the rope is" in capsys.readouterr().err
    assert [one.name for one in here.iterdir() if one.suffix == ".csv"] == []


def test_see_replaces_none_of_its_own_files(here, capsys):
    (here / "photo.png").write_text("a photo")
    words = ["see", "photo.png", "--length", "1m", "--overwrite", "--out"]
    for out, told in (("photo.csv", "would replace photo.png"), ("rope.png", "is a .csv")):
        assert main([*words, out]) == 2
        assert told in capsys.readouterr().err
    assert (here / "photo.png").read_text() == "a photo"


@pytest.mark.slow
def test_a_plan_is_exported_for_an_arm_beside_it(found, here, capsys):
    (here / "plan.json").write_text(found.to_json())
    code = main(["export", "plan.json", "--max-speed", "0.2", "--format", "ros2"])
    told = capsys.readouterr().out
    assert code == (1 if "cannot be reached" in told else 0)
    assert "peak at the tip" in told
    assert (here / "panda-joint.yaml").read_text().startswith("#")
    assert main(["export", "plan.json", "--format", "ros2"]) == 2
    assert "panda-joint.yaml exists already" in capsys.readouterr().err
    (here / "part.json").write_text(replace(found, solved=False, reason="no time").to_json())
    assert main(["export", "part.json", "--out", "new/part.csv"]) == 1
    assert f"this is not a whole plan for {found.goal}: no time" in capsys.readouterr().out
    assert (here / "new" / "part.csv").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing.json"], "nothing.json"),
        (["plan.json", "--arm", "nothing.xml"], "nothing.xml"),
        (["plan.json", "--max-speed", "0"], "max_speed must be above 0"),
        (["plan.json", "--base", "nothing.yaml"], "nothing.yaml"),
        (["plan.json", "--tip", "hand"], "--tip hand: the panda has its own gripper"),
    ],
)
def test_what_cannot_be_exported_is_2_and_leaves_nothing(words, message, found, here, capsys):
    (here / "plan.json").write_text(found.to_json())
    assert main(["export", *words]) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in here.iterdir()] == ["plan.json"]


@pytest.mark.parametrize("content", [b"", b"time_s,x_m\n", b"\x89PNG"])
def test_a_file_that_is_no_plan_is_named(content, here, capsys):
    (here / "file").write_bytes(content)
    assert main(["export", "file"]) == 2
    assert "knotflow: file: " in capsys.readouterr().err


def test_two_files_of_demonstrations_merge_into_one(here, capsys):
    shipped = load_demonstrations()
    save_demonstrations(here / "ada.jsonl", shipped[:2])
    save_demonstrations(here / "ben.jsonl", shipped[2:3])
    files = ["merge", "ada.jsonl", "ben.jsonl", "--out"]
    assert main([*files, "both.jsonl"]) == 0
    assert "both.jsonl: 3 demonstrations by scripted" in capsys.readouterr().out
    assert len(load_demonstrations(here / "both.jsonl")) == 3
    assert main([*files, "both.jsonl"]) == 2
    assert main(["merge", "ada.jsonl", "ada.jsonl", "--out", "double.jsonl"]) == 2
    assert "is the same demonstration as ada.jsonl, line 1" in capsys.readouterr().err
    assert not (here / "double.jsonl").exists()


def test_the_studio_without_its_extra_names_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.delitem(sys.modules, "knotflow.apps.studio.page", raising=False)
    assert main(["studio"]) == 2
    assert "pip install 'knotflow[studio]'" in capsys.readouterr().err


def test_an_arm_without_its_extra_names_it(monkeypatch, found, here, capsys):
    (here / "plan.json").write_text(found.to_json())
    monkeypatch.setitem(sys.modules, "mink", None)
    assert main(["export", "plan.json"]) == 2
    assert "pip install 'knotflow[arm]'" in capsys.readouterr().err


def test_a_plan_that_ties_nothing_says_what_to_try(searches, found, monkeypatch, capsys):
    failed = replace(found, solved=False, reason="60 s passed")
    monkeypatch.setattr(search, "find_plan", lambda *_, **__: (failed, None))
    for _ in range(2):  # found, and told again
        assert main(["plan", LOOP, "--rope", "straight"]) == 1
        assert "--overwrite --max-seconds 120" in capsys.readouterr().out
