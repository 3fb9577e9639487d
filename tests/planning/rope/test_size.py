import numpy as np
import pytest

from knotflow.planning import RopeInputError, parse_goal
from knotflow.planning.frame import Placement
from knotflow.planning.rope.size import STIFFNESS, RopeSize, parse_length, parse_metres
from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    control_points,
    random_curve,
)

GRAVITY = 9.81


@pytest.mark.parametrize(
    ("text", "metres"),
    [("6mm", 0.006), ("6 mm", 0.006), ("0.6cm", 0.006), ("0.7", 0.7), ("0.7 m", 0.7)],
)
def test_lengths_are_read_in_their_units(text, metres):
    assert parse_metres(text, "--length") == pytest.approx(metres)


@pytest.mark.parametrize("text", ["", "0", "-1mm", "6in", "mm", "..", "nan", "1e999"])
def test_what_is_no_length_is_refused(text):
    with pytest.raises(RopeInputError, match="--diameter.* is no length: write 6mm"):
        parse_metres(text, "--diameter")


def test_lengths_without_a_unit_are_usual_ones():
    assert parse_length("3cm") == pytest.approx(0.03) and parse_length("30m") == 30.0
    for text, told in (("30", "without a unit .* 0.05 to 20 m"), ("1mm", "is 0.01 to 100 m")):
        with pytest.raises(RopeInputError, match=f"--length {text}: .*{told}"):
            parse_length(text)


def test_rope_of_one_metre_is_the_model_rope():
    assert RopeSize.of(1.0).model() == RopeConfig()
    assert RopeSize.of(1.0, "10mm", "medium").model() == RopeConfig()


def test_model_rope_has_the_named_bending_length():
    rope = RopeConfig()
    weight = rope.density * np.pi * rope.radius**2 * GRAVITY
    stiffness = rope.joint_stiffness * rope.link_length
    assert (stiffness / weight) ** (1 / 3) == pytest.approx(rope.bending_length, rel=1e-3)


def test_ropes_of_one_material_bend_by_their_thickness_alone():
    lengths = [RopeSize.of(length, "10mm").bending_length for length in (0.5, 1.0, 3.0)]
    assert lengths == pytest.approx([RopeConfig().bending_length] * 3)
    thick = RopeSize.of(2.0, "80mm").bending_length
    assert thick == pytest.approx(4 * RopeConfig().bending_length)
    assert RopeSize.of(3.0, "0.1mm", "soft").bending_length == pytest.approx(3.0 / 500)


@pytest.mark.parametrize("stiffness", [*STIFFNESS, "3cm"])
def test_bending_length_is_that_of_the_links(stiffness):
    size = RopeSize.of(2.0, "8mm", stiffness)
    rope = size.model(60)
    weight = rope.density * np.pi * rope.radius**2 * GRAVITY
    bending = (rope.joint_stiffness * rope.link_length / weight) ** (1 / 3)
    assert bending * size.length == pytest.approx(size.bending_length, rel=1e-3)
    if stiffness == "3cm":
        assert size.bending_length == pytest.approx(0.03)


@pytest.mark.parametrize("length", [0.3, 1.0, 3.0])
def test_the_rope_in_its_real_size_bends_under_its_own_weight_as_the_model(length):
    size = RopeSize.of(length, f"{0.015 * length}", "soft")
    rope = size.rope()
    assert (rope.length, rope.radius) == (length, pytest.approx(0.0075 * length))
    assert rope.links == size.model().links
    weight = rope.density * np.pi * rope.radius**2 * GRAVITY
    bending = (rope.joint_stiffness * rope.link_length / weight) ** (1 / 3)
    assert bending == pytest.approx(size.bending_length, rel=1e-3)


def ratios(rope):
    """What decides how a rope moves: its hinges' stiffness, damping and inertia, relative to those
    of a link's weight, and its thickness."""
    step = rope.link_length
    inertia = rope.density * np.pi * rope.radius**2 * step**3
    rate = np.sqrt(GRAVITY / step)  # 1/s
    hinge = rope.joint_stiffness / rate**2, rope.joint_damping / rate, rope.joint_armature
    return np.array([*hinge, inertia]) / inertia


@pytest.mark.parametrize("diameter", ["0.2mm", "4mm"])
@pytest.mark.parametrize("length", [0.3, 3.0])
def test_a_rope_and_its_model_have_the_same_ratios(length, diameter):
    size = RopeSize.of(length, diameter)
    np.testing.assert_allclose(ratios(size.rope()), ratios(size.model()))


def test_a_rope_too_stiff_for_its_length_is_told():
    cable, overhand, eight = (
        RopeSize(1.0, 0.006, 0.1),
        parse_goal("overhand"),
        parse_goal("figure_eight"),
    )
    assert "10 cm, a figure eight takes 1.3 m" in cable.doubts(eight)
    assert not cable.doubts(overhand) and not RopeSize(1.3, 0.006, 0.1).doubts(eight)


def test_links_follow_from_length_over_diameter():
    assert RopeSize.of(1.0, "10mm").links == RopeConfig().links
    assert RopeSize.of(0.5, "4mm").links == 48
    assert RopeSize.of(2.0, "20mm").links == RopeSize.of(0.2, "2mm").links


def test_thickness_out_of_range_is_refused_or_told():
    with pytest.raises(
        RopeInputError, match="--diameter 6: 6 m is more than a twentieth.*as in 6mm"
    ):
        RopeSize.of(1.0, "6")
    thread = RopeSize.of(1.0, "0.5mm")
    assert "simulated 2 mm thick" in thread.describe()
    assert thread.model().radius == pytest.approx(0.001)


@pytest.mark.parametrize(("length", "diameter"), [(0.7, "35mm"), (1.4, "7cm"), (2.8, "14cm")])
def test_the_largest_diameter_is_taken(length, diameter):
    assert RopeSize.of(length, diameter).diameter == pytest.approx(length / 20)


@pytest.mark.parametrize("diameter", ["1mm", "2mm", "10mm"])
def test_a_thin_rope_has_the_bending_length_that_is_said(diameter):
    size = RopeSize.of(1.0, diameter)
    assert size.rope().bending_length == pytest.approx(size.bending_length)


@pytest.mark.parametrize("stiffness", ["4", "0.001mm"])
def test_a_stiffness_that_is_no_bending_length_is_refused(stiffness):
    with pytest.raises(RopeInputError, match=f"--stiffness {stiffness}.*as in 4cm"):
        RopeSize.of(1.0, stiffness=stiffness)


def test_model_moves_as_the_rope_itself():
    """Simulated in metres and seconds, and in units of its length: the same shapes."""
    size = RopeSize.of(0.5, "4mm")
    rope = size.model()
    model = SimulationConfig(rope=rope, threads=1)
    start = random_curve(rope, np.random.default_rng(0))
    spline = np.array([0.05, start[20, 0], start[20, 1], 0.06, 0.2, 0.1])
    time = np.sqrt(size.length)  # of a unit of the model
    real = SimulationConfig(
        rope=size.rope(),
        timestep=model.timestep * time,
        contact_time=model.contact_time * time,
        pace=model.pace * size.length / time,
        ramp_time=model.ramp_time * time,
        rest_speed=model.rest_speed * size.length / time,
        settle_time=model.settle_time * time,
        record_rate=model.record_rate / time,
        threads=1,
    )
    at = Placement(size.length, 0.01, -0.02)
    modelled = RopeSimulator(model).execute(start[None], spline[None])
    executed = RopeSimulator(real).execute(at.points(start)[None], at.splines(spline)[None])
    moved = np.abs(modelled.end_points - start).max()
    assert moved > 0.1
    count = min(modelled.frames[0], executed.frames[0])
    np.testing.assert_allclose(
        at.points(modelled.trajectory[0, :count]), executed.trajectory[0, :count], atol=5e-3
    )
    np.testing.assert_allclose(at.times(modelled.release_times), executed.release_times, rtol=0.02)


def test_placed_splines_have_placed_control_points():
    at, rng = Placement(0.5, 0.2, -0.1), np.random.default_rng(0)
    rope = RopeConfig()
    start, spline = random_curve(rope, rng), np.array([0.3, 0.1, 0.2, 0.1, -0.3, 0.4])
    controls = control_points(start, spline, rope.radius)
    placed = control_points(at.points(start), at.splines(spline), at.length * rope.radius)
    np.testing.assert_allclose(placed, at.points(controls), atol=1e-12)
