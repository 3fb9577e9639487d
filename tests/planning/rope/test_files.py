"""Tables of points as files have them: separators, headers, units, and what is refused."""

import numpy as np
import pytest

from knotflow.planning import RopeInputError
from knotflow.planning.rope.files import RopeTable, checked, read_table

BOW = np.column_stack(
    [np.sin(np.linspace(-0.5, 0.5, 20)), np.cos(np.linspace(-0.5, 0.5, 20)) - 0.9, np.zeros(20)]
).round(4)


def rows(separator=",", scale=1.0, decimal="."):
    lines = (separator.join(f"{scale * value:.4f}" for value in point) for point in BOW)
    return "\n".join(lines).replace(".", decimal) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        rows(),
        "x,y,z\n" + rows(),
        "\ufeffx,y,z\n" + rows(),
        rows(";"),
        "x;y;z\n" + rows(";", decimal=","),
        rows("\t"),
        rows(" "),
        rows().replace("\n", "\r\n"),
        "# Tuesday, the long rope\n\nx,y,z\n" + rows() + "# the end\n\n",
        "x [mm],y [mm],z [mm]\n" + rows(scale=1000.0),
        "x_cm, y_cm, z_cm\n" + rows(scale=100.0),
        "x (meters),y (meters),z (meters)\n" + rows(),
        "X_millimetres,Y_millimetres,Z_millimetres\n" + rows(scale=1000.0),
        "t,z,y,x\n" + "\n".join(f"7,{z},{y},{x}" for x, y, z in BOW),
        rows().replace("0.9794", '"0.9794"'),
    ],
)
def test_tables_of_every_habit_hold_the_same_points(tmp_path, text):
    path = tmp_path / "rope.csv"
    path.write_text(text, "utf-8", newline="")
    np.testing.assert_allclose(read_table(path).points, BOW, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no points"),
        ("# nothing\n", "holds no points"),
        ("x,y,z\n0,0,0\n1,one,0\n", "line 3: y is 'one', which is no number"),
        (rows() + "0.1,0.2\n", "line 21: has no z; complete the row or delete it"),
        (rows() + "0.1,,0.2\n", "line 21: has no y"),
        ("# a\n\n" + rows() + "1,2,3,4\n", "line 23: .*more values.*header row"),
        ("x,y,z\nm,m,m\n" + rows(), "line 2: x is 'm'.*only one header row"),
        ("x [mm],y [m],z [m]\n" + rows(), "different units"),
        (rows().replace("0.", '"0.', 1), "line 1"),
        ("0,0,0\n", "1 points are too few"),
        ("x [in],y [in],z [in]\n" + rows(), r"has 'x \[in\]'; .*units are m, cm, mm"),
        ("x_ft,y_ft,z_ft\n" + rows(), "has 'x_ft'; .*units are m, cm, mm"),
        ("x_inches,y_inches,z_inches\n" + rows(), "has 'x_inches'; .*units are m, cm, mm"),
        ("x,y,z,x,y,z\n" + rows(), "names x twice"),
        ("nan,nan,nan\n" + rows(), "line 1: x is 'nan'"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line_and_the_cure(tmp_path, text, message):
    path = tmp_path / "rope.csv"
    path.write_text(text)
    with pytest.raises(RopeInputError, match=message) as caught:
        read_table(path)
    assert "rope.csv" in str(caught.value)


def test_other_alphabets_are_refused(tmp_path):
    (tmp_path / "rope.csv").write_text(rows(), "utf-16")
    with pytest.raises(RopeInputError, match="not UTF-8 text"):
        read_table(tmp_path / "rope.csv")


@pytest.mark.parametrize(
    "content", [np.array([{1: 2}]), np.array(["a"]), BOW[:, :1], np.zeros((9, 3), complex)]
)
def test_arrays_that_are_no_rope_are_refused(tmp_path, content):
    np.save(tmp_path / "rope.npy", content, allow_pickle=True)
    with pytest.raises(RopeInputError, match=r"array|shape \(20, 1\)"):
        read_table(tmp_path / "rope.npy")


def test_bytes_that_are_no_array_are_refused(tmp_path):
    (tmp_path / "rope.npy").write_bytes(b"nothing")
    with pytest.raises(RopeInputError, match="no NumPy file.*numpy.save"):
        read_table(tmp_path / "rope.npy")


def test_units_are_those_asked_for_or_the_headers(tmp_path):
    np.save(tmp_path / "rope.npy", 1000.0 * BOW)
    np.testing.assert_allclose(read_table(tmp_path / "rope.npy", "mm").points, BOW, atol=1e-12)
    with pytest.raises(RopeInputError, match="unknown unit 'km'.*m, cm, mm"):
        read_table(tmp_path / "rope.npy", "km")
    (tmp_path / "rope.csv").write_text("x [mm],y [mm],z [mm]\n" + rows(scale=1000.0))
    np.testing.assert_allclose(read_table(tmp_path / "rope.csv", "mm").points, BOW, atol=1e-9)
    with pytest.raises(RopeInputError, match="header says mm, but cm was asked for"):
        read_table(tmp_path / "rope.csv", "cm")


def test_a_table_of_points_is_checked():
    with pytest.raises(RopeInputError, match="unknown unit 'inch'; there are m, cm, mm"):
        checked(RopeTable(BOW, "inch"))
    np.testing.assert_array_equal(checked(RopeTable(BOW.tolist())).points, BOW)
    with pytest.raises(RopeInputError, match="the rope: a rope's points"):
        checked(RopeTable([["a", "b"]]))
