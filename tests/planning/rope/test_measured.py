"""Ropes to tie, generated and from files."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from knotflow.planning import (
    ROPE_NAMES,
    RopeInputError,
    RopeOptions,
    lay_down,
    measured_rope,
    parse_rope,
    read_rope,
)
from knotflow.planning.rope.files import MAX_POINTS, read_table
from knotflow.simulation import RopeConfig, check_points, straight
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw

ROPE = RopeConfig()
OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")


def bow(count):
    """A gently bent rope of 1 m, (count, 3)."""
    angle = np.linspace(-0.5, 0.5, count)
    return np.stack([np.sin(angle), np.cos(angle) - 0.9, np.zeros(count)], axis=1)


def write(folder, points, name="rope.csv", header="x,y,z"):
    np.savetxt(folder / name, points, delimiter=",", header=header, comments="")
    return folder / name


@pytest.mark.parametrize("name", ROPE_NAMES)
def test_generated_ropes_are_untangled(name):
    points = parse_rope(name, ROPE, np.random.default_rng(0))
    check_points(points, ROPE)
    assert TopologicalState.from_curve(points) == TopologicalState.trivial()


@pytest.mark.parametrize(
    ("options", "told"),
    [({"cut": 0}, "--cut"), ({"up": "y"}, "--up"), ({"crossings": "1o2+"}, "--crossings")],
)
def test_options_of_a_file_are_refused_for_a_generated_rope(options, told):
    with pytest.raises(RopeInputError, match=f"the rope is random: {told} are for the file"):
        measured_rope("random", RopeOptions(**options), np.random.default_rng(0))


def test_the_seed_draws_the_random_rope():
    draws = [parse_rope("random", ROPE, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])


@pytest.mark.parametrize("count", [5, 41, 400])
@pytest.mark.parametrize("header", ["x,y,z", ""])
def test_a_csv_of_any_number_of_points_is_resampled(tmp_path, count, header):
    curve = bow(count)
    curve[:, 2] = 0.3  # a table of any height
    path = tmp_path / "rope.csv"
    np.savetxt(path, curve, delimiter=",", header=header, comments="")
    points = parse_rope(str(path), ROPE, np.random.default_rng(0))
    check_points(points, ROPE)
    np.testing.assert_allclose(points[:, 2], ROPE.radius)
    # Corners of a coarse file are cut by up to a hundredth of its rope.
    np.testing.assert_allclose(points[[0, -1], :2], curve[[0, -1], :2], atol=0.015)


def test_npy_and_csv_agree(tmp_path):
    np.save(tmp_path / "rope.npy", bow(30))
    from_npy = read_rope(tmp_path / "rope.npy", ROPE)
    np.testing.assert_allclose(from_npy, read_rope(write(tmp_path, bow(30)), ROPE), atol=1e-12)


@pytest.mark.parametrize("length", [0.04, 25.0])
def test_a_rope_of_any_size_is_read_in_metres(tmp_path, length):
    rope = replace(ROPE, length=length, radius=0.005 * length)
    np.save(tmp_path / "rope.npy", straight(rope))
    if length < 1:
        np.testing.assert_allclose(read_rope(tmp_path / "rope.npy", rope), straight(rope))
    else:
        with pytest.raises(RopeInputError, match="splines"):
            read_rope(tmp_path / "rope.npy", rope)


def test_a_rope_of_the_model_stays_as_it_is(tmp_path):
    np.save(tmp_path / "rope.npy", straight(ROPE))
    np.testing.assert_allclose(read_rope(tmp_path / "rope.npy", ROPE), straight(ROPE), atol=1e-9)


@pytest.mark.parametrize("gap", [0.002, 0.016, 0.3])
def test_a_tangled_rope_keeps_its_state_and_gets_room_at_its_crossings(gap):
    fine = RopeConfig(links=80, radius=0.004)
    curve = draw(OVERHAND, gap=gap)
    points = lay_down(curve, fine)
    check_points(points, fine)
    assert TopologicalState.from_curve(points) == OVERHAND
    assert points[:, 2].max() < 8 * fine.radius
    assert points[:, 2].min() >= 0.9 * fine.radius


def test_a_rope_without_heights_lies_on_the_table(tmp_path):
    along = np.linspace(-0.5, 0.5, 41)  # as many points as the model has
    np.savetxt(tmp_path / "flat.csv", np.column_stack([along, 0 * along]), delimiter=",")
    rng = np.random.default_rng(0)
    measured = measured_rope(str(tmp_path / "flat.csv"), RopeOptions(), rng)
    np.testing.assert_allclose(measured.points[:, 2], measured.model.radius, atol=1e-9)


def test_a_rope_at_rest_keeps_its_heights():
    fine = RopeConfig(links=80, radius=0.004)
    resting = lay_down(draw(OVERHAND, gap=0.002), fine)
    np.testing.assert_allclose(lay_down(resting, fine), resting, atol=1e-6)


def replaced(points, index, value):
    points = points.copy()
    points[index] = value
    return points


def crossing_flat():
    """A loop whose strands cross at one height."""
    angle = np.linspace(-4.2, 4.2, 100)
    curve = np.stack([0.12 * np.sin(angle) + 0.01 * angle, 0.12 * np.cos(angle), 0 * angle], axis=1)
    return curve / np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (replaced(bow(20), (3, 1), np.nan), "line 4: y is 'nan', which is no number"),
        (replaced(bow(20), (4, 0), np.inf), "point 4"),
        (bow(4), "4 points are too few"),
        (np.ones((9, 3)), "all points are the same"),
        (2.0 * bow(20), "2 m long, not 1 m"),
        (100 * bow(20), r"--rope-unit m \(.*, cm \(1 m\)"),
        (1000 * bow(20), r"--rope-unit m \(.*, mm \(1 m\)"),
        (bow(20) + [0.4, 0, 0], "out of the splines' reach"),
        (np.concatenate([bow(20)[:12], bow(20)[10:2:-1]]), "Neither an end nor two strands"),
        (crossing_flat(), "z must say which strand of"),
    ],
)
def test_a_file_that_is_no_rope_is_refused_with_the_reason(tmp_path, points, message):
    with pytest.raises(RopeInputError, match=message) as caught:
        read_rope(write(tmp_path, points, header=""), ROPE)
    assert "rope.csv" in str(caught.value)


def test_a_fold_is_too_sharp_for_the_links(tmp_path):
    fold = [[0, 0, 0], [0.4, 0, 0], [0.4, 0.01, 0], [-0.18, 0.02, 0], [-0.19, 0.02, 0]]
    with pytest.raises(RopeInputError, match="mm off these points: they are tighter"):
        read_rope(write(tmp_path, np.array(fold)), ROPE)


def test_crossings_finer_than_the_links_are_refused(tmp_path):
    coarse = RopeConfig(links=8)
    write(tmp_path, draw(OVERHAND))
    with pytest.raises(RopeInputError, match="cannot lie with these 3 crossings"):
        read_rope(tmp_path / "rope.csv", coarse)


def test_what_is_no_rope_at_all_names_what_would_be(tmp_path):
    rng = np.random.default_rng(0)
    with pytest.raises(RopeInputError, match="straight, arc, random"):
        parse_rope("strait", ROPE, rng)
    with pytest.raises(RopeInputError, match="no such rope file"):
        parse_rope(str(tmp_path / "missing.csv"), ROPE, rng)


def test_a_rope_that_hangs_is_told_so_in_a_line(tmp_path):
    hanging = np.zeros((46, 3))
    hanging[:, 2] = np.linspace(1.0, 0.0, 46)
    with pytest.raises(RopeInputError, match="hangs rather.* 0.00 to 1.00 m high") as caught:
        read_rope(write(tmp_path, hanging), ROPE)
    assert "rope.csv" in str(caught.value)


@pytest.mark.slow
def test_very_many_points_take_little_memory_and_give_the_same_rope(tmp_path):
    angle = np.linspace(-0.5, 0.5, 200_000)
    np.save(tmp_path / "many.npy", np.column_stack([np.sin(angle), np.cos(angle) - 0.9, 0 * angle]))
    assert len(read_table(tmp_path / "many.npy").points) == MAX_POINTS
    tracemalloc.start()
    points = read_rope(tmp_path / "many.npy", RopeConfig())
    assert tracemalloc.get_traced_memory()[1] < 200 * 2**20
    tracemalloc.stop()
    np.testing.assert_allclose(points[0, :2], [np.sin(-0.5), np.cos(-0.5) - 0.9], atol=1e-4)
