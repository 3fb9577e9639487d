"""A photograph's rope in the studio: corrected, in doubt until confirmed, laid and planned for."""

from copy import deepcopy
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree
from tests.perception.photographs import centre_line, photograph

from knotflow.apps.studio.photograph import PhotoError, Photograph
from knotflow.apps.studio.session import Session, StudioError
from knotflow.perception import ImageError
from knotflow.planning import RopeInputError
from knotflow.topology import TopologicalState, parse_action

SHAPE = (240, 320)
OVERHAND = [True, False, True]


@pytest.fixture(scope="module")
def pictures():
    """(H, W, 3) of an overhand, of one whose upper strands cannot be told, and of an arc."""
    line = centre_line("overhand", SHAPE)
    flat = photograph(line, OVERHAND, SHAPE, width=7, shading=0, shadow=0, noise=8)
    arc = photograph(centre_line("arc", (150, 300)), [], (150, 300), width=5)
    return {"sure": photograph(line, OVERHAND, SHAPE, width=7), "flat": flat, "arc": arc}


@pytest.fixture(scope="module")
def photos(pictures):
    return {name: Photograph(f"{name}.png", rgb) for name, rgb in pictures.items()}


@pytest.fixture
def sure(photos):
    return deepcopy(photos["sure"])


@pytest.fixture
def flat(photos):
    return deepcopy(photos["flat"])


def png(rgb):
    Image.fromarray(rgb).save(file := BytesIO(), "png")
    return file.getvalue()


@pytest.mark.slow
def test_a_line_that_is_not_moved_keeps_its_state(sure):
    before, places = sure.found, sure.places
    for handle, index in list(enumerate(sure.handles))[::5]:
        sure.drag(handle, sure.found.pixels[index])
    assert sure.state == before.state
    assert sure.doubts == ()
    assert sure.places == pytest.approx(places, abs=0.5)
    off, _ = cKDTree(sure.found.pixels).query(before.pixels)
    assert off.max() < 0.75  # pixels, half a step of the line


@pytest.mark.slow
def test_swaps_flip_a_crossing_and_twice_is_identity(sure):
    before, first_over = sure.state, [one.first_over for one in sure.found.crossings]
    sure.swap(1)
    now = [one.first_over for one in sure.found.crossings]
    assert [one != was for one, was in zip(now, first_over, strict=True)] == [False, True, False]
    flipped = {(under, over, -sign) for over, under, sign in sure.state.crossings}
    assert len(flipped & {*before.crossings}) == 1
    sure.swap(1)
    assert sure.state == before


@pytest.mark.slow
def test_head_and_tail(sure):
    before, ends = sure.state, sure.found.pixels[[0, -1]]
    sure.reverse()
    assert sure.state == before.reversed()
    assert sure.found.pixels[[-1, 0]] == pytest.approx(ends)
    sure.reverse()
    assert sure.state == before


@pytest.mark.slow
def test_a_drag_is_smooth_local_and_can_be_undone(sure):
    before, handle = sure.found.pixels, len(sure.handles) // 2
    place = before[sure.handles[handle]] + [6, 4]
    bent = sure.dragged(handle, place)
    assert bent[sure.handles[handle]] == pytest.approx(place)
    assert np.abs(np.diff(bent - before, axis=0)).max() < 0.5
    assert (bent == before).all(axis=1).mean() > 0.5
    sure.drag(handle, place)
    assert np.linalg.norm(sure.found.pixels - place, axis=1).min() < 1
    sure.undo()
    assert sure.found.pixels is before
    with pytest.raises(PhotoError, match="no change"):
        sure.undo()


@pytest.mark.slow
def test_a_tail_dragged_off_its_strand_leaves_a_crossing_fewer(sure):
    swapped = sure.found.crossings[0]
    sure.swap(0)
    inside = sure.found.pixels[round(0.9 * len(sure.found.pixels))]
    sure.drag(len(sure.handles) - 1, inside)
    assert len(sure.found.crossings) == 2
    assert any("accounts for" in one for one in sure.doubts)  # the picture shows another rope
    kept = sure.found.crossings[0]
    assert kept.fractions == pytest.approx(swapped.fractions, abs=0.1)
    assert kept.first_over != swapped.first_over  # as was said, not as the picture has it


@pytest.mark.slow
def test_a_rope_in_doubt_is_not_laid_before_it_is_confirmed(flat):
    flat.length = "0.9m"
    assert any("cannot be told" in one for one in flat.doubts)
    with pytest.raises(PhotoError, match="in doubt: crossing"):
        flat.rope()
    flat.confirm()
    assert flat.doubts == ()
    outside = flat.found.pixels[-1] + [0.0, 40.0]
    flat.drag(len(flat.handles) - 1, outside)
    assert flat._accepted <= {*flat.found.doubts, *flat._path_doubts}  # of this shape alone
    flat.undo()
    measured = flat.rope()
    assert TopologicalState.from_curve(measured.points) == flat.state
    assert measured.size.length == 0.9
    assert measured.size.diameter == pytest.approx(0.9 * flat.found.width / flat.found.length, 1e-3)
    flat.undo()
    assert flat.doubts


@pytest.mark.parametrize("number", [None, 99])
def test_a_click_on_a_crossing_that_is_gone_is_answered(sure, number):
    with pytest.raises(PhotoError, match="gone"):
        sure.swap(number)


@pytest.mark.slow
def test_a_swap_settles_its_crossing(flat):
    for number, one in enumerate(flat.found.crossings):
        if one.certainty < 0.95:
            flat.swap(number)
            flat.swap(number)
    assert not any("cannot be told" in one for one in flat.doubts)


@pytest.mark.slow
def test_length_and_diameter_are_asked_for_and_checked(photos):
    photo = deepcopy(photos["arc"])
    with pytest.raises(PhotoError, match="no scale: write the rope's length"):
        photo.rope()
    photo.length = "long"
    with pytest.raises(RopeInputError, match="the length 'long'"):
        photo.rope()
    photo.length, photo.diameter = "90cm", "9mm"
    assert photo.rope().size.diameter == pytest.approx(0.009)
    photo.diameter = "9cm"
    with pytest.raises(RopeInputError, match="twentieth"):
        photo.rope()


def test_the_name_of_a_photograph_is_no_path(sure, tmp_path):
    sure.name, sure.length = str(tmp_path / "victim.jpg"), "0.9m"
    sure.rope()
    assert not [*tmp_path.iterdir()]


def test_pictures_without_a_rope_say_why(tmp_path):
    session = Session("straight", tmp_path / "mine.jsonl")
    with pytest.raises(ImageError, match=r"^table.png: no rope is seen"):
        session.read_photo("table.png", png(np.full((90, 120, 3), 60, np.uint8)))
    with pytest.raises(ImageError, match=r"^notes.txt: .*image"):
        session.read_photo("notes.txt", b"no picture")
    with pytest.raises(ImageError, match="name such as red"):
        session.read_photo("table.png", png(np.zeros((90, 120, 3), np.uint8)), "reddish")
    assert session.photo is None and session.laid


@pytest.mark.slow
def test_the_photographs_rope_is_the_one_that_is_planned_for(pictures, tmp_path, monkeypatch):
    session = Session("random", tmp_path / "mine.jsonl")
    vars(session)["library"] = None
    asked = []

    def plan_rope(points, knot, rng, *, simulation, **options):
        asked.append((points, simulation.rope))
        raise StudioError("searched")

    monkeypatch.setattr("knotflow.apps.studio.session.plan_rope", plan_rope)
    photo = session.read_photo("arc.png", png(pictures["arc"]))
    with pytest.raises(PhotoError, match="length"):
        session.search("overhand", print)
    photo.length = "0.5m"
    with pytest.raises(StudioError, match="searched"):
        session.search("overhand", print)
    ((points, rope),) = asked
    assert session.laid and session.photo is photo
    assert points is session.points and rope == session.rope == session.measured.model
    assert 0.5 * rope.radius == pytest.approx(photo.size.diameter / 2, rel=1e-3)
    with pytest.raises(StudioError, match="1 m by 10 mm"):
        session.begin(parse_action("R1(0,1,1)"))
    session.open_photo()
    assert not session.laid
    session.lay_named("straight")
    assert session.photo is None and session.rope == session.simulation.rope
