"""The studio's session: ropes, demonstrations, plans, without a browser."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from knotflow.apps.studio.session import ROPES, Session, StudioError
from knotflow.perception import SAMPLE
from knotflow.perception.camera.image import read_depth
from knotflow.planning import RopeInputError, RopeOptions
from knotflow.samplers.demonstrations import TASKS, load_demonstrations, task
from knotflow.simulation import straight
from knotflow.topology import IllegalActionError, TopologicalState, parse_action

SHOWN = load_demonstrations()[0]
"""R1(0,1,1) into the straight rope."""


@pytest.fixture
def session(tmp_path):
    return Session("straight", tmp_path / "mine.jsonl")


def demonstrate(session, spline, action):
    draft = session.begin(parse_action(action))
    draft.clicks[:] = [(spline[0],), tuple(spline[1:3]), tuple(spline[4:])]
    draft.height = spline[3]
    return session.simulate()


@pytest.mark.parametrize("name", ROPES)
def test_every_named_rope_can_be_laid(session, name):
    session.lay_named(name)
    wanted = {f"start of {one.action}": one.start_state for one in TASKS}
    assert session.state == wanted.get(name, TopologicalState.trivial())


def test_uploaded_file_is_laid(session, tmp_path):
    rows = "\n".join(",".join(map(str, row)) for row in straight(session.simulation.rope)[::-1])
    session.lay_upload("mine.csv", rows.encode())
    assert session.points[0, 0] > 0
    with pytest.raises(RopeInputError, match="^other.csv, line 1: has no y"):
        session.lay_upload("../other.csv", b"1\n")


def test_a_file_or_an_image_may_show_a_rope_of_any_size(session, monkeypatch):
    curve = 2.2 * straight(session.simulation.rope)
    rows = "\n".join(",".join(map(str, row)) for row in curve + [0.3, 0.0, 0.0])
    session.lay_upload("mine.csv", rows.encode())
    assert session.measured.size.length == pytest.approx(2.2, rel=1e-3)
    assert session.measured.size.diameter == pytest.approx(0.022, rel=1e-3)
    session.lay_upload("mine.csv", rows.encode(), RopeOptions(diameter="11mm"))
    assert session.rope.radius == pytest.approx(0.0025, rel=1e-3)
    assert np.ptp(session.points[:, 0]) == pytest.approx(1.0, abs=0.01)
    assert session.measured.placement.x == pytest.approx(0.3, abs=0.01)
    with pytest.raises(StudioError, match="1 m by 10 mm"):
        session.begin(parse_action("R1(0,1,1)"))
    with pytest.raises(RopeInputError, match=r"^mine.csv: this rope would be 2.2 m long, not 1 m"):
        session.lay_upload("mine.csv", rows.encode(), RopeOptions(length="1m"))

    def estimate(image, camera, rope, **_):
        asked.append(rope)
        return SimpleNamespace(points=0.7 * straight(session.simulation.rope), all_ambiguities=())

    asked = []
    monkeypatch.setattr("knotflow.perception.io.estimate", estimate)
    names = {"rgb": "overhand.png", "depth": "overhand-depth.png", "camera": "camera.yaml"}
    files = {key: (name, (SAMPLE / name).read_bytes()) for key, name in names.items()}
    assert session.lay_image(files, RopeOptions(length="0.7m", diameter="8mm")) == ()
    assert asked[0].length == 0.7 and asked[0].radius == 0.004
    assert session.measured.size.length == 0.7 and len(session.points) == asked[0].links + 1
    depth = io.BytesIO()
    np.save(depth, 1e-3 * read_depth(SAMPLE / "overhand-depth.png"))
    session.lay_image({**files, "depth": ("depth.npy", depth.getvalue())}, RopeOptions())
    for key, name in (("depth", "my-depth.png"), ("camera", "my-camera.yaml")):
        with pytest.raises(ValueError, match=f"^{name}: "):
            session.lay_image({**files, key: (name, b"no such thing")})


def test_only_offered_names_are_laid(session, tmp_path):
    path = tmp_path / "secret.csv"
    path.write_text("\n".join(f"{0.025 * k - 0.5},0,0" for k in range(41)))
    before = session.points
    for name in (str(path), "../secret.csv", "/etc/passwd", ""):
        with pytest.raises(StudioError, match="there is no rope"):
            session.lay_named(name)
    assert session.points is before
    assert Session(str(path), tmp_path / "mine.jsonl").points.shape == before.shape


def test_offered_actions_are_legal_with_tasks_first(session):
    session.lay_named("start of C(0,1,1)")
    actions = session.actions()
    assert len(actions) == len(set(actions))
    assert {session.state.apply(action) for action in actions}
    ours = {one.action for one in TASKS if one.start_state == session.state}
    assert ours <= set(actions[: len(TASKS)])


def test_kept_demonstration_has_name_and_time(session):
    tried = demonstrate(session, SHOWN.spline, "R1(0,1,1)")
    assert tried.success[0]
    session.keep(" Ada ")
    (one,) = session.kept()
    assert (one.source, one.who, one.task) == ("human", "Ada", SHOWN.task)
    assert one.when[:2] == "20" and one.when[-6] in "+-"
    assert one.spline == pytest.approx(SHOWN.spline)
    assert session.draft is None


def test_unfit_demonstrations_are_not_kept(session):
    with pytest.raises(StudioError, match="choose an action"):
        session.simulate()
    with pytest.raises(StudioError, match="simulate a demonstration"):
        session.keep("Ada")
    demonstrate(session, np.array([0.5, 0.0, 0.1, 0.1, 0.0, 0.05]), "R1(0,1,1)")
    with pytest.raises(StudioError, match="did not reach its state"):
        session.keep("Ada")
    demonstrate(session, SHOWN.spline, "R1(0,1,1)")
    with pytest.raises(StudioError, match="write your name"):
        session.keep("  ")
    session.draft.height = 0.15
    with pytest.raises(StudioError, match="have changed since"):
        session.keep("Ada")
    assert session.kept() == []


def test_illegal_action_cannot_be_begun(session):
    with pytest.raises(IllegalActionError):
        session.begin(task("C(2,0,1)").action)
    assert session.draft is None


def test_another_rope_drops_draft_and_plan(session):
    session.begin(parse_action("R1(0,1,1)"))
    session.lay_named("arc")
    assert session.draft is None and session.plan is None


@pytest.mark.parametrize("turn", ["read_photo", "open_photo"])
def test_a_photograph_drops_draft_and_plan(session, monkeypatch, turn):
    monkeypatch.setattr("knotflow.apps.studio.photograph.Photograph", lambda *_: object())
    session.begin(parse_action("R1(0,1,1)"))
    session.plan = object()
    picture = io.BytesIO()
    Image.new("RGB", (40, 30)).save(picture, "png")
    if turn == "read_photo":
        session.read_photo("rope.png", picture.getvalue())
    else:
        session.open_photo()
    assert session.draft is None and session.plan is None
    with pytest.raises(StudioError, match="choose an action"):
        session.simulate()


def test_no_rope_is_laid_while_something_runs(session):
    before = session.points
    with session._busy, pytest.raises(StudioError, match="is running"):
        session.lay_named("arc")
    assert session.points is before
    session.lay_named("arc")
    assert session.points is not before


@pytest.mark.slow
def test_plan_is_found_and_can_be_played(session):
    from knotflow.apps.studio.playback import plan_frames

    updates = []
    plan = session.search("R1(0,1,1)", updates.append)
    assert plan.solved and updates
    shown = plan_frames(plan)
    assert len(shown) == len(plan.steps[0].times)
    assert shown[0].rope == pytest.approx(session.points, abs=1e-6)
    assert "R1(0,1,1)" in shown[0].caption
