"""Whatever is given, the answer is a valid result or an error of ours that says what is wrong.

    BAD_INPUTS=10000 python -m pytest tests/apps/test_bad_inputs.py -s

makes so many inputs (a few hundred without it) and prints what they met: how many were refused, the
slowest in seconds of processor time, and how far memory grew.
"""

from __future__ import annotations

import io
import json
import os
import resource
import struct
import tempfile
import time
import traceback
import zlib
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from PIL import Image

import knotflow
from knotflow.apps.tasks import TieTask
from knotflow.perception import SAMPLE, Calibration, Camera, RgbdImage, segment
from knotflow.perception.camera.image import read_colour, read_depth
from knotflow.planning import parse_goal, parse_rope
from knotflow.planning.rope.files import read_table
from knotflow.recording import RecordedRollout, read_recording, write_recording
from knotflow.samplers.demonstrations import SHIPPED, load_demonstrations
from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    check_points,
    check_splines,
    clip_splines,
    random_curve,
    resample,
    straight,
)
from knotflow.topology import R1, R2, Cross, TopologicalState, parse_action

pytestmark = pytest.mark.slow
TOTAL = int(os.environ.get("BAD_INPUTS", "300"))
SECONDS = 2.0
"""Of processor time, that the answer to one input may take."""
MEMORY = 2**30
"""Bytes by which one input may let the process grow."""
OURS = str(Path(knotflow.__file__).parent)


@dataclass
class Met:
    """What the inputs have met so far."""

    inputs: int = 0
    refused: int = 0
    slowest: float = 0.0
    grown: int = 0


MET = Met()


def bad_inputs(share: float) -> Callable[[Callable], Callable]:
    """So large a share of all inputs goes to a test; always the same ones."""
    return settings(
        max_examples=max(5, round(share * TOTAL)),
        derandomize=True,
        database=None,
        phases=(Phase.explicit, Phase.generate),  # shrinking would take minutes
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )


@contextmanager
def answered(*errors: type[Exception]) -> Iterator[Path]:
    """What is done within succeeds or is refused by an error that knotflow itself raises, a
    ValueError or one of `errors`, in time and memory, and leaves no file in the folder given,
    which is the working folder and that for temporary files, too."""
    with tempfile.TemporaryDirectory() as home:
        folder, given = Path(home) / "work", Path(home) / "given"
        folder.mkdir()
        given.mkdir()
        before, tempfile.tempdir = tempfile.tempdir, str(folder)
        begun, peak = time.process_time(), _peak()
        try:
            with chdir(folder), _no_more_than(MEMORY):
                yield given
        except (ValueError, *errors) as error:
            _check_ours(error)
            MET.refused += 1
        finally:
            tempfile.tempdir = before
        took, grown = time.process_time() - begun, _peak() - peak
        assert took < SECONDS, f"took {took:.1f} s"
        assert not list(folder.iterdir()), "left files behind"
    MET.inputs += 1
    MET.slowest, MET.grown = max(MET.slowest, took), max(MET.grown, grown)


def _check_ours(error: Exception) -> None:
    """An error is ours where knotflow raised it; what a library says is no help to a person."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    assert frame.filename.startswith(OURS) and "raise" in (frame.line or ""), error
    assert str(error).strip(), "an error without a word"


def _peak() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


@contextmanager
def _no_more_than(growth: int) -> Iterator[None]:
    """Whatever asks for more memory gets a MemoryError."""
    limits = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + growth, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


@pytest.fixture(scope="module", autouse=True)
def told():
    yield
    print(
        f"\n{MET.inputs} inputs, {MET.refused} of them refused, the slowest took "
        f"{MET.slowest:.2f} s, memory grew by {MET.grown / 2**20:.0f} MiB at most"
    )


ROPE = RopeConfig()
LINE = straight(ROPE)

# What goes wrong in numbers, and in text that is nearly right.
numbers = st.one_of(
    st.floats(-1, 1), st.floats(), st.integers(-3, 50), st.integers(), st.sampled_from([0, -1, 1e9])
)
junk = st.one_of(numbers, st.none(), st.booleans(), st.text(max_size=5), st.binary(max_size=5))
nested = st.recursive(junk, lambda inner: st.lists(inner, max_size=4), max_leaves=12)
curves = st.builds(
    lambda seed: random_curve(ROPE, np.random.default_rng(seed)), st.integers(0, 200)
)
walks = st.builds(
    lambda steps: np.cumsum(steps, axis=0) * 0.03,
    arrays(np.float64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.floats(-1, 1)),
)
loops = st.builds(
    lambda turns, rise: np.column_stack(
        [
            0.2 * np.cos(turns * np.linspace(0, 1, 60)) + np.linspace(0, 0.3, 60),
            0.2 * np.sin(turns * np.linspace(0, 1, 60)),
            rise * np.linspace(0, 1, 60),
        ]
    ),
    st.floats(0, 40),
    st.floats(-0.2, 0.2),
)
anything = arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.bool_]),
    array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=6),
)
shapes = st.one_of(curves, walks, loops, anything)


@st.composite
def broken(draw, source):
    """Points of which some are not what they were."""
    points = np.array(draw(source), dtype=np.float64)
    for _ in range(draw(st.integers(0, 2))):
        assume(points.size)
        points.flat[draw(st.integers(0, points.size - 1))] = draw(st.floats())
    return points


@st.composite
def mutated(draw, content: bytes):
    """Bytes of which some were changed, cut, or put in."""
    changed = bytearray(content)
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, max(len(changed) - 1, 0)))
        cut = draw(st.integers(0, 30))
        changed[at : at + cut] = draw(st.binary(max_size=30))
    return bytes(changed[: draw(st.integers(0, len(changed)))] if draw(st.booleans()) else changed)


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def huge_npy(shape: tuple[int, ...]) -> bytes:
    """An NPY file that announces more numbers than it holds."""
    header = repr({"descr": "<f8", "fortran_order": False, "shape": shape})
    text = header.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + bytes(64)


@st.composite
def tables(draw):
    """The text of a CSV file."""
    mark = draw(st.sampled_from([",", ";", "\t", " ", ", "]))
    header = draw(st.sampled_from(["", "x,y,z", "x [mm],y [mm],z [mm]", "a,b", "x,x,x", "z [in]"]))
    cells = st.one_of(
        numbers.map(str), st.sampled_from(["", "nan", "1,5", '"', "# no", "0x1f", "1e400"]),
        st.text(max_size=6),
    )  # fmt: skip
    if draw(st.booleans()):
        rows = [[str(x) for x in row] for row in np.atleast_2d(draw(broken(curves | loops))) * 1.0]
        for _ in range(draw(st.integers(0, 3))):
            row = draw(st.sampled_from(rows))
            row[draw(st.integers(0, 2)) :] = draw(st.lists(cells, max_size=2))
    else:
        rows = draw(st.lists(st.lists(cells, max_size=5), max_size=20))
    return "\n".join([header, *(mark.join(row) for row in rows)])


rope_files = st.one_of(
    tables().map(lambda text: (".csv", text.encode("utf-8", "surrogatepass"))),
    st.binary(max_size=200).map(lambda data: (".csv", data)),
    broken(shapes).map(lambda points: (".npy", npy(points))),
    anything.map(lambda array: (".npy", npy(array))),
    mutated(npy(LINE)).map(lambda data: (".npy", data)),
    st.tuples(st.integers(0, 10**12), st.integers(0, 5)).map(lambda s: (".npy", huge_npy(s))),
    st.tuples(st.sampled_from([".txt", "", ".CSV", ".npz"]), st.binary(max_size=50)),
)


@pytest.fixture(scope="module")
def one_file_read(tmp_path_factory):
    """What pandas and Arrow reserve once is not counted."""
    path = tmp_path_factory.mktemp("rope") / "rope.csv"
    np.savetxt(path, LINE, delimiter=",", header="x [m],y,z", comments="")
    read_table(path)


@bad_inputs(0.16)
@given(file=rope_files, unit=st.sampled_from([None, "m", "cm", "mm", "inch"]))
def test_rope_files(one_file_read, file, unit):
    suffix, content = file
    with answered() as folder:
        path = folder / f"rope{suffix}"
        path.write_bytes(content)
        read_table(path, unit)
    with answered() as folder:
        path = folder / f"rope{suffix}"
        path.write_bytes(content)
        rope = parse_rope(str(path), ROPE, np.random.default_rng(0))
        assert rope.shape == (ROPE.num_vertices, 3) and np.isfinite(rope).all()


@bad_inputs(0.12)
@given(points=broken(shapes))
def test_rope_arrays(points):
    with answered():
        state = TopologicalState.from_curve(points)
        assert TopologicalState.parse(str(state)) == state
        check_points(resample(points, ROPE), ROPE)


@bad_inputs(0.03)
@given(points=broken(shapes) | st.just(LINE))
def test_starts_of_tasks(points):
    with answered():
        TieTask.single("R1(0,1,1)", points)
    with answered():
        TieTask.tie("overhand", np.asarray(points)[None])


@st.composite
def states(draw):
    """A state that actions lead to."""
    state = TopologicalState.trivial()
    for _ in range(draw(st.integers(0, 4))):
        state = draw(st.sampled_from([onward for _, onward in state.actions()]))
    return state


@st.composite
def tokens(draw):
    """Texts of the words that states, actions and knots are written with."""
    words = ["overhand", "figure_eight", "trivial", "unknot", "4o1+", "2o5+", "6o3+", "1o2-"]
    words += ["R1(0,1,1)", "C(0,1,1)", "R2(0,0,1,1)", "C(2,0,1)", "undo ", "arrange for ", "o", "("]
    words += [")", "[", "(4,1,1)", ",", " ", "-", "+", "99999999999o1+", "R1(", "C(9999999,0,1)"]
    return "".join(draw(st.lists(st.sampled_from(words) | st.text(max_size=3), max_size=8)))


goals = st.one_of(tokens(), states().map(str), st.text(max_size=20), nested.map(str))


@bad_inputs(0.12)
@given(text=goals, rope=st.sampled_from([ROPE, None]))
def test_goals(text, rope):
    with answered():
        goal = parse_goal(text, rope)
        assert goal.states and all(state in goal.dag for state in goal.states)


@bad_inputs(0.1)
@given(
    text=goals, crossings=st.lists(st.lists(st.integers(-1, 7), max_size=4), max_size=4) | nested
)
def test_states(text, crossings):
    with answered():
        state = TopologicalState.parse(text)
        assert TopologicalState.parse(str(state)) == state
    with answered():
        TopologicalState.from_crossings(crossings)


@bad_inputs(0.1)
@given(
    text=tokens() | st.text(max_size=12),
    state=states(),
    kind=st.sampled_from([R1, R2, Cross]),
    values=st.lists(st.integers(-2, 9) | junk, min_size=4, max_size=4),
)
def test_actions(text, state, kind, values):
    with answered():
        action = parse_action(text)
        assert parse_action(str(action)) == action
        state.apply(action)
    with answered():
        state.apply(kind(*values[: len(fields(kind))]))


@pytest.fixture(scope="module")
def simulator():
    made = RopeSimulator(SimulationConfig(threads=1))
    made.execute(LINE[None], np.array([[0.5, 0, 0, 0.1, 0, 0]]))  # what is made once is not counted
    return made


splines = st.one_of(
    arrays(np.float64, (1, 6), elements=st.floats(-0.6, 0.6)),
    arrays(np.float64, st.tuples(st.integers(0, 3), st.integers(5, 7)), elements=st.floats()),
    anything,
    nested,
)


@bad_inputs(0.1)
@given(values=splines, points=st.just(LINE) | broken(curves | anything))
def test_splines(simulator, values, points):
    with answered():
        rollouts = simulator.execute(points[None], check_splines(values))
        assert np.isfinite(rollouts.end_points).all()
    with answered():
        check_splines(clip_splines(values))


@bad_inputs(0.05)
@given(
    values=st.dictionaries(st.sampled_from([field.name for field in fields(RopeConfig)]), numbers),
    times=st.dictionaries(
        st.sampled_from([field.name for field in fields(SimulationConfig)][1:]), numbers
    ),
    starts=st.dictionaries(
        st.sampled_from([field.name for field in fields(StartsConfig)]),
        st.integers(-2, 8) | numbers,
    ),
)
def test_configurations(values, times, starts):
    with answered():
        rope = RopeConfig(**values)
        RopeSimulator(SimulationConfig(rope))
    with answered():
        SimulationConfig(**times)
    with answered(RuntimeError):
        StartsConfig(**starts)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "one.mcap"
    write_recording(path, [rollout(outcome="failure")], {"stage": "test"})
    return path.read_bytes()


def rollout(**changed) -> RecordedRollout:
    values: dict[str, Any] = dict(
        times=np.array([0.0, 0.1]),
        points=np.stack([LINE, LINE]),
        gripper=np.zeros((2, 3)),
        control_points=np.zeros((3, 3)),
        spline=np.zeros(6),
        action="R1(0,1,1)",
        start_state="trivial",
        goal_state="2o1+",
        end_state="",
        signature="test",
        source="test",
        number=0,
    )
    return RecordedRollout(**values | changed)


@bad_inputs(0.08)
@given(data=st.data())
def test_recordings(recording, data):
    with answered(FileNotFoundError) as folder:
        path = folder / "some.mcap"
        path.write_bytes(data.draw(mutated(recording) | st.binary(max_size=60)))
        assert len(list(read_recording(path))) == 1
    names = ["times", "points", "gripper", "control_points", "spline"]
    changes = data.draw(st.dictionaries(st.sampled_from(names), anything | nested, max_size=2))
    with answered():
        rollout(**changes, outcome=data.draw(st.just("failure") | st.text(max_size=9)))


LINES = SHIPPED.read_text("utf-8").splitlines()


@bad_inputs(0.06)
@given(data=st.data())
def test_demonstrations(data):
    row = json.loads(data.draw(st.sampled_from(LINES)))
    names = [*row, "start", "who", "when"]
    row |= data.draw(st.dictionaries(st.sampled_from(names), nested | tokens(), max_size=2))
    for name in data.draw(st.lists(st.sampled_from(names), max_size=1)):
        row.pop(name, None)
    line = json.dumps(row, default=str).encode()
    with answered() as folder:
        path = folder / "some.jsonl"
        path.write_bytes(data.draw(st.just(line) | mutated(line)))
        load_demonstrations(path)


CAMERA = (SAMPLE / "camera.yaml").read_bytes()
SEEN = Image.open(SAMPLE / "overhand.png"), Image.open(SAMPLE / "overhand-depth.png")


def png(image: Image.Image) -> bytes:
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


def huge_png(size: tuple[int, int]) -> bytes:
    """A PNG file that announces more pixels than it holds."""
    header = b"IHDR" + struct.pack(">IIBBBBB", *size, 8, 2, 0, 0, 0)
    data = b"IDAT" + zlib.compress(bytes(60))
    chunks = (struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c))
              for c in (header, data))  # fmt: skip
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


pictures = st.one_of(
    mutated(png(SEEN[0].resize((64, 48)))),
    mutated(png(SEEN[1].resize((64, 48)))),
    arrays(np.uint8, (48, 64, 3)).map(lambda array: png(Image.fromarray(array))),
    arrays(np.uint16, (48, 64)).map(lambda array: png(Image.fromarray(array))),
    st.sampled_from([(40_000, 40_000), (9_000, 9_000), (10**6, 1), (0, 0)]).map(huge_png),
    st.binary(max_size=60),
)
depths = st.one_of(
    pictures.map(lambda data: (".png", data)),
    anything.map(lambda array: (".npy", npy(array))),
    st.tuples(st.integers(0, 10**12), st.integers(0, 5)).map(lambda s: (".npy", huge_npy(s))),
    arrays(np.float32, (48, 64), elements=st.floats(0, 2, width=32)).map(
        lambda array: (".npy", npy(array))
    ),
)
PINHOLE = Camera.overhead(64, 48)


@bad_inputs(0.08)
@given(rgb=pictures, depth=depths)
def test_images(rgb, depth):
    with answered() as folder:
        (folder / "rgb.png").write_bytes(rgb)
        (folder / f"depth{depth[0]}").write_bytes(depth[1])
        raw = read_depth(folder / f"depth{depth[0]}")
        image = RgbdImage(read_colour(folder / "rgb.png"), raw.astype(np.float32))
        segment(image, PINHOLE, ROPE.radius)


@bad_inputs(0.08)
@given(data=st.data())
def test_cameras(data):
    with answered() as folder:
        path = folder / "camera.yaml"
        path.write_bytes(data.draw(mutated(CAMERA) | st.binary(max_size=40)))
        Calibration.load(path).camera()
    names = [field.name for field in fields(Camera)]
    values = {name: getattr(PINHOLE, name) for name in names}
    changes = data.draw(st.dictionaries(st.sampled_from(names), junk | anything, max_size=2))
    with answered():
        camera = Camera(**values | changes)
        assert camera.project([0.0, 0.0, 0.0]).shape == (3,)
