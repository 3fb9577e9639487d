"""Centre lines as people measure them, generated, and the files of a folder of real ones."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotflow.planning import Frame, RopeInputError, RopeOptions, RopeTable, measured_rope
from knotflow.planning.rope.files import read_table
from knotflow.simulation import RopeConfig, check_points, random_curve
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw
from knotflow.topology.polyline import arc_lengths

LOOP = TopologicalState.parse("1o2-")
OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")
CASES = Path(__file__).parents[3].parent / "shared" / "real" / "cases"


def line(state=OVERHAND, count=200, length=1.0, ratio=0.01):
    """A centre line (count, 3) of a drawn rope, evenly sampled, metres."""
    curve = draw(state, gap=ratio)
    along = arc_lengths(curve)
    at = np.linspace(0.0, along[-1], count)
    return length * np.column_stack([np.interp(at, along, column) for column in curve.T])


def measured(path, points, header="x,y,z", **options):
    np.savetxt(path / "mine.csv", points, delimiter=",", header=header, comments="")
    return measured_rope(str(path / "mine.csv"), RopeOptions(**options), np.random.default_rng(0))


def state_of(rope):
    check_points(rope.points, rope.model)
    return TopologicalState.from_curve(rope.points)


def in_file(rope):
    """The laid rope (V, 3) in the frame and unit of its file."""
    return rope.frame.to_file(rope.placement.points(rope.points))


@pytest.mark.parametrize("ratio", [1 / 50, 1 / 100, 1 / 250, 1 / 500])
@pytest.mark.parametrize("length", [0.2, 1.0, 3.0])
def test_any_size_keeps_its_state(tmp_path, length, ratio):
    points = line(LOOP, 120, length, ratio)
    rope = measured(tmp_path, points, diameter=f"{1e3 * ratio * length:.6f}mm")
    assert state_of(rope) == LOOP
    assert rope.size.length == pytest.approx(length, rel=0.02)
    np.testing.assert_allclose(in_file(rope)[[0, -1]], points[[0, -1]], atol=0.02 * length)


@pytest.mark.parametrize(
    ("count", "noise", "smoothed"),
    [
        (25, 0.003, False),
        (60, 0.002, False),
        (60, 0.006, True),
        (99, 0.005, True),
        (300, 0.001, True),
        (900, 0.002, True),
    ],
)
def test_noise_is_smoothed(tmp_path, count, noise, smoothed):
    points = line(OVERHAND, count)
    noisy = points + np.random.default_rng(1).normal(0, noise, points.shape) * [1, 1, 0.3]
    rope = measured(tmp_path, noisy)
    assert state_of(rope) == OVERHAND
    assert rope.size.length == pytest.approx(1.0, abs=0.06)
    assert any("rms) off a smooth curve" in remark for remark in rope.remarks) == smoothed


@pytest.mark.parametrize("unit", ["m", "cm", "mm"])
def test_points_come_back_in_frame_and_unit(tmp_path, unit):
    turn = Rotation.from_rotvec([0.3, -0.2, 0.0]).as_matrix()
    points = (line() @ turn.T + [3.0, -2.0, 1.5]) / {"m": 1, "cm": 0.01, "mm": 0.001}[unit]
    rope = measured(tmp_path, points, rope_unit=unit)
    assert state_of(rope) == OVERHAND
    assert any(re.search(r"tilted by (20|21)\.", remark) for remark in rope.remarks)
    apart = np.linalg.norm(in_file(rope)[:, None] - points[None], axis=2).min(axis=1)
    assert apart.max() < 0.015 / {"m": 1, "cm": 0.01, "mm": 0.001}[unit]


@pytest.mark.parametrize("degrees", [4, 8])
def test_a_slight_tilt_is_found_where_the_rope_is_flat_across_it(tmp_path, degrees):
    tilt = Rotation.from_euler("y", degrees, degrees=True)
    bent = random_curve(RopeConfig(), np.random.default_rng(5))
    rope = measured(tmp_path, tilt.apply(bent))
    assert any(f"tilted by {degrees}.0 degrees" in remark for remark in rope.remarks)
    assert np.ptp(tilt.inv().apply(in_file(rope))[:, 2]) < 0.003
    crossing = measured(tmp_path, tilt.apply(line(LOOP)))
    assert (
        np.ptp(tilt.inv().apply(in_file(crossing))[:, 2]) < 0.02 < np.ptp(in_file(crossing)[:, 2])
    )
    level = measured(tmp_path, line(LOOP))
    assert not any("tilted" in remark for remark in level.remarks)


@pytest.mark.parametrize("diameter", ["10mm", "16mm"])
def test_a_rope_that_rises_steeply_gets_more_links(diameter):
    options = RopeOptions(diameter=diameter)
    file = Path(__file__).parents[1] / "pentagram_at_rest.csv"
    rope = measured_rope(str(file), options, np.random.default_rng(0))
    assert state_of(rope).num_crossings == 5


def test_an_estimate_is_laid_as_its_file_would_be(tmp_path, rng):
    points = line(OVERHAND, 60, 0.9).round(6)
    written = measured(tmp_path, points, diameter="8mm")
    laid = measured_rope(RopeTable(points), RopeOptions(diameter="8mm"), rng)
    np.testing.assert_array_equal(laid.points, written.points)
    assert (laid.size, laid.remarks) == (written.size, written.remarks)
    assert laid.hand.config.opening == pytest.approx(0.05 / laid.size.length)
    with pytest.raises(RopeInputError, match=r"photo\.jpg: --rope-unit is for the file of a rope"):
        measured_rope(RopeTable(points, name="photo.jpg"), RopeOptions(rope_unit="mm"), rng)
    with pytest.raises(RopeInputError, match=r"photo\.jpg: point 3 .* must be finite"):
        measured_rope(
            RopeTable(np.where(np.arange(60)[:, None] == 3, np.nan, points), name="photo.jpg"),
            RopeOptions(), rng,
        )  # fmt: skip
    with pytest.raises(RopeInputError, match="has no z, so that --up y says nothing of it"):
        measured_rope(RopeTable(line(LOOP)[:, :2]), RopeOptions(up="y"), rng)


def test_frames_are_inverted_and_written():
    frame = Frame(Rotation.from_rotvec([0.3, 0.1, -2.0]).as_matrix(), 0.7, "mm")
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(frame.from_file(frame.to_file(points)), points, atol=1e-12)
    again = Frame.from_json(frame.to_json())
    np.testing.assert_array_equal(again.to_file(points), frame.to_file(points))
    np.testing.assert_array_equal(Frame().to_file(points), points)


@pytest.mark.parametrize(
    ("up", "columns", "signs"),
    [("y", (1, 2, 0), 1), ("x", (2, 0, 1), 1), ("-z", (0, 1, 2), (1, -1, -1))],
)
def test_another_axis_points_up_where_it_is_said(tmp_path, up, columns, signs):
    points = line()[:, columns] * signs
    rope = measured(tmp_path, points, up=up)
    assert state_of(rope) == OVERHAND
    np.testing.assert_allclose(in_file(rope)[0], points[0], atol=0.02)
    if up != "-z":
        with pytest.raises(RopeInputError, match="degrees from level.*--up x, -x, y"):
            measured(tmp_path, points)


def test_points_that_hang_are_refused_by_their_heights(tmp_path):
    along = np.linspace(-1, 1, 40)
    hanging = np.column_stack([0.3 * along, 0.1 * along**3, 0.1 + 0.35 * along**2])
    with pytest.raises(RopeInputError, match=r"mine.csv.*hangs.*0.10 to 0.45 m high \(z\)"):
        measured(tmp_path, hanging)


def test_xy_without_crossing_needs_nothing(tmp_path):
    points = line(TopologicalState.trivial(), 40)[:, :2]
    assert state_of(measured(tmp_path, points, "x,y")) == TopologicalState.trivial()


def test_xy_with_crossings_asks_which_strand_is_on_top(tmp_path):
    points = line()[:, :2]
    with pytest.raises(RopeInputError, match=r"no z.*column over.*--crossings: 4o1\+ or 1o4-"):
        measured(tmp_path, points, "x,y")
    rope = measured(tmp_path, points, "x,y", crossings=str(OVERHAND))
    assert state_of(rope) == OVERHAND
    other = TopologicalState.parse("1o4-5o2-3o6-")
    assert state_of(measured(tmp_path, points, "x,y", crossings=str(other))) == other
    with pytest.raises(RopeInputError, match=r"1o2- are not this curve's; seen from above it has"):
        measured(tmp_path, points, "x,y", crossings="1o2-")


def test_a_rope_stays_where_it_was_measured_whatever_its_length(tmp_path):
    points = np.column_stack([np.linspace(-0.476, 0.476, 100), np.zeros((100, 2))])
    rope = measured(tmp_path, points, length="1m")
    assert rope.size.length == 1.0
    np.testing.assert_allclose(in_file(rope)[[0, -1], 0], [-0.476, 0.476], atol=1e-3)


def test_column_over_says_which_strand_is_on_top(tmp_path):
    points = line()
    table = np.column_stack([points[:, :2], points[:, 2] > 0.005])
    assert state_of(measured(tmp_path, table, "x,y,over")) == OVERHAND
    table[:, 2] = 0
    with pytest.raises(RopeInputError, match=r"over must say which strand of 4o1\+ or 1o4-"):
        measured(tmp_path, table, "x,y,over")


def test_crossings_that_are_given_count_for_a_rope_at_rest_too(tmp_path):
    points = measured(tmp_path, line(LOOP, 120), diameter="10mm").points
    assert state_of(measured(tmp_path, points, diameter="10mm")) == LOOP
    given = measured(tmp_path, points, diameter="10mm", crossings="2o1+")
    assert state_of(given) == TopologicalState.parse("2o1+")


def test_strands_at_one_height_are_asked_for(tmp_path):
    points = line() * [1, 1, 0.05]
    with pytest.raises(
        RopeInputError, match="z.*more than 0.001, but differs by 0.0005; .*--crossings"
    ):
        measured(tmp_path, points)
    assert state_of(measured(tmp_path, points, diameter="4mm")) == OVERHAND  # limits scale


def ring(count=80):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) / (2 * np.pi)


@pytest.mark.parametrize("points", [ring(2000), np.repeat(ring(), 2, axis=0)])
def test_a_cut_counts_the_points_of_the_file(tmp_path, points):
    rope = measured(tmp_path, points, cut=len(points) // 4)
    np.testing.assert_allclose(in_file(rope)[0, :2], points[len(points) // 4, :2], atol=0.01)


@pytest.mark.parametrize(
    ("header", "columns"), [("frame,x_pos,y_pos", (2, 0, 1)), ("x,z,over", (0, 1, 2))]
)
def test_columns_that_are_not_x_y_z_are_not_taken_for_them(tmp_path, header, columns):
    with pytest.raises(RopeInputError, match="where x, y and z are expected"):
        measured(tmp_path, line()[:, columns], header)


@pytest.mark.parametrize("header", ["px,py,pz", "x_pos,y_pos,z_pos"])
def test_columns_named_much_like_x_y_z_are_read_by_position(tmp_path, header):
    assert state_of(measured(tmp_path, line(), header)) == OVERHAND


def test_empty_columns_are_left_out(tmp_path):
    rows = [",".join(f"{number:.4f}" for number in point) + ",\n" for point in line()]
    (tmp_path / "rope.csv").write_text("".join(rows))
    assert read_table(tmp_path / "rope.csv").points.shape == line().shape


@pytest.mark.parametrize("repeated", [False, True])
def test_closed_curve_is_cut_where_it_is_said(tmp_path, repeated):
    points = ring()
    closed = np.concatenate([points, points[:1]]) if repeated else points
    with pytest.raises(RopeInputError, match="a closed curve.*--cut 0.*--cut open"):
        measured(tmp_path, closed)
    rope = measured(tmp_path, closed, cut=20)
    np.testing.assert_allclose(in_file(rope)[0, :2], points[20, :2], atol=0.01)
    assert any("cut at point 20" in remark for remark in rope.remarks)
    with pytest.raises(RopeInputError, match="--cut 99: its points are 0 to"):
        measured(tmp_path, closed, cut=99)
    with pytest.raises(RopeInputError, match="open already"):
        measured(tmp_path, line(), cut=0)
    assert measured(tmp_path, ring()[:-1], cut="open").remarks[0].startswith("rope of")


def test_clouds_are_told_from_lines(tmp_path):
    points = line(LOOP, 400)
    shuffled = np.random.default_rng(0).permutation(points)
    with pytest.raises(RopeInputError, match="no line.*cloud of points.*head to tail"):
        measured(tmp_path, shuffled)


def test_xyz_and_vect_are_read(tmp_path):
    points = line(LOOP, 60)
    rows = "\n".join(" ".join(f"{value:.6f}" for value in point) for point in points)
    atoms = "\n".join(f"C {row}" for row in rows.splitlines())
    texts = {
        "plain.xyz": rows,
        "atoms.xyz": f"60\nfrom a scan\n{atoms}",
        "open.vect": f"VECT\n1 60 0\n60\n0\n{rows}",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        rope = measured_rope(str(tmp_path / name), RopeOptions(), np.random.default_rng(0))
        assert state_of(rope) == LOOP
    refused = {
        "closed.vect": (f"VECT\n1 60 0\n-60\n0\n{rows}", "a closed curve"),
        "two.vect": (f"VECT\n2 60 0\n30 30\n0 0\n{rows}", "one polyline; this one has 2"),
        "not.vect": ("OFF\n1 1 1 1 1", "does not begin with VECT"),
        "cut.vect": ("VECT\n1 3 0\n3\n0\n0 0 0 1 1", "point 1.*not x, y, z"),
    }
    for name, (text, message) in refused.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(RopeInputError, match=f"{name}.*{message}"):
            measured_rope(str(tmp_path / name), RopeOptions(), np.random.default_rng(0))


def test_lengths_that_need_a_unit_are_asked_for(tmp_path):
    points = line(LOOP, 60)
    with pytest.raises(RopeInputError, match=r"97\d m long: .*--rope-unit.*mm \(0.97"):
        measured(tmp_path, 977.0 * points)
    with pytest.raises(RopeInputError, match="be 0.999 m long, not 2 m: give its --length"):
        measured(tmp_path, points, length="2")
    with pytest.raises(RopeInputError, match=r"not 1 m: .*mm \(0.99"):
        measured(tmp_path, 1000 * points, length="1m")
    assert measured(tmp_path, points, length="1.03m").size.length == 1.03


@pytest.mark.parametrize("count", [15, 40, 99])
def test_points_out_of_order_are_refused(tmp_path, count):
    points = np.random.default_rng(0).permutation(line(LOOP, count))
    for columns, header in ((3, "x,y,z"), (2, "x,y")):
        with pytest.raises(RopeInputError, match="points out of order"):
            measured(tmp_path, points[:, :columns], header)


def test_a_rope_without_heights_that_crosses_itself_often_is_refused_in_few_words(tmp_path):
    along = np.linspace(0, 1, 99)
    wave = np.column_stack([0.25 * np.sin(40 * np.pi * along), 0.1 * along])
    across = np.column_stack([0.2 - 0.4 * along, 0.05 + 0.01 * along])
    with pytest.raises(RopeInputError, match="which strand is on top.* and .* others") as caught:
        measured(tmp_path, np.concatenate([wave, across]), "x,y")
    assert len(str(caught.value)) < 600


@pytest.mark.slow
def test_tight_loops_get_shorter_links_or_are_refused(tmp_path):
    angle = np.linspace(-0.9 * np.pi, 0.9 * np.pi, 60)
    loop = np.column_stack([np.sin(angle), -np.cos(angle)])
    way = loop[-1] - loop[-2]
    legs = np.linspace(0.05, 1, 60)[:, None] * way / np.linalg.norm(way)

    def shape(radius):
        one, other = radius * loop[0] - 0.45 * legs[::-1] * [1, -1], radius * loop[-1] + 0.45 * legs
        xy = np.concatenate([one, radius * loop, other])
        return np.column_stack([xy, np.where(np.arange(len(xy)) > 90, 0.01, 0.0)])

    wide, tight = (measured(tmp_path, shape(radius)) for radius in (0.05, 0.018))
    assert state_of(wide) == state_of(tight)
    assert len(tight.points) > len(wide.points) == 41
    with pytest.raises(RopeInputError, match="tighter than a rope of this size bends; .*diameter"):
        measured(tmp_path, shape(0.004))
    assert state_of(measured(tmp_path, shape(0.008), diameter="3mm")) == state_of(wide)


@pytest.mark.skipif(not CASES.is_dir(), reason="the folder of real inputs is not here")
@pytest.mark.parametrize(
    ("name", "options", "outcome"),
    [
        ("hanging_cable", {}, "hangs.*0.10 to 0.48 m high"),
        ("thin_rope_loop", {"diameter": "3.3mm"}, LOOP),
        ("thin_rope_loop", {}, LOOP),
        ("dense_noisy_loop", {}, LOOP),
        ("clean_loop", {}, LOOP),
        ("tight_loop", {}, LOOP),
        ("tight_loop", {"diameter": "6mm"}, LOOP),
        ("trace_xy", {}, TopologicalState.trivial()),
        ("short_rope_05m", {"diameter": "4mm"}, LOOP),
        ("thread_02m", {"diameter": "0.4mm"}, LOOP),
    ],
)
def test_real_centre_lines(name, options, outcome):
    path, rng = str(CASES / f"{name}.csv"), np.random.default_rng(0)
    if isinstance(outcome, str):
        with pytest.raises(RopeInputError, match=f"{name}.csv.*{outcome}"):
            measured_rope(path, RopeOptions(**options), rng)
    else:
        assert state_of(measured_rope(path, RopeOptions(**options), rng)) == outcome
