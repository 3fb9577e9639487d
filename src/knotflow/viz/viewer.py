"""Recordings in the Rerun viewer: in a window, in a browser, as a file, or checked headless."""

from __future__ import annotations

import os
import platform
import socket
import subprocess
import sys
import tempfile
import textwrap
import time
from ctypes.util import find_library
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from knotflow.recording import load, messages
from knotflow.recording.reader import existing_recording, recordings_in
from knotflow.recording.rollout import NANOSECONDS
from knotflow.viz.rerun_file import (
    TIMELINE,
    ViewerError,
    no_such_number,
    rerun_program,
    run_rerun,
    save_rerun,
)

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient, ViewerState

_VIEWS = ("3D", "TextLog")
_SCENE = (messages.ROPE, messages.ROPE_LINE, messages.GRIPPER, messages.SPLINE)
_TOPICS = (*_SCENE, messages.TOPOLOGY)
_TIMEOUT = 20.0  # seconds for a headless viewer to show a recording
_GREETING = 6.0  # seconds until Rerun's notices are gone from the screenshot
_REPORT_LENGTH = 300  # letters: Rerun spells out whole Arrow types


def show(
    recording: Path,
    number: int | None = None,
    save: Path | None = None,
    headless_check: Path | None = None,
    web: bool = False,
) -> int:
    """Show a recording; the arguments are those of `knotflow view`.

    Returns:
        The exit code: 1 if a headless check found problems, else 0.

    Raises:
        OSError, ValueError: no such recording, or a damaged one.
        ViewerError: no viewer can be opened.
    """
    source = find_recording(recording, number)
    if recording.is_dir() and len(files := recordings_in(recording)) > 1:
        names = ", ".join(file.name for file in files)
        print(f"showing {source.name} of {len(files)} recordings: {names}")
    if save is not None:
        print(f"saved {save_rerun(source, save, number=number)}")
    if headless_check is not None:
        report = check_recording(source, number=number, delay=_GREETING)
        headless_check.write_bytes(report.screenshot)
        for problem in report.problems:
            print(problem, file=sys.stderr)
        print(f"{source}: {len(report.problems)} problems; shows {', '.join(report.entities)}")
        return 1 if report.problems else 0
    if web:
        serve_recording(source, number=number)
    elif save is None:
        open_recording(source, number=number)
    return 0


def find_recording(path: str | os.PathLike[str], number: int | None = None) -> Path:
    """The one recording that a path and a rollout number mean.

    A file means itself. In a folder it is the file that holds the number, or without a number
    the first file by name.

    Raises:
        FileNotFoundError: nothing is there, or the folder has no recording.
        NotARecordingError, DamagedRecordingError: the file is no MCAP, or cut or changed.
        ValueError: no rollout, or more than one, has this number.
    """
    place = Path(path)
    if not place.is_dir():
        return existing_recording(place)
    if number is None:
        return existing_recording(recordings_in(place)[0])
    table = load(place)
    files = table.loc[table["number"] == number, "file"].tolist()
    if not files:
        raise ValueError(no_such_number(place, number, table["number"].tolist()))
    if len(files) > 1:
        raise ValueError(f"rollout {number} is in several recordings, name one: {files}")
    return Path(files[0])


def open_recording(path: Path, *, number: int | None = None) -> None:
    """Show a recording, or one of its rollouts, in a Rerun window; returns when it is closed."""
    with tempfile.TemporaryDirectory(prefix="knotflow-view-") as folder:
        rrd = save_rerun(path, Path(folder) / "recording.rrd", number=number)
        try:
            # An open viewer would take the file over and return before it has read it.
            run_rerun(str(rrd), "--new")
        except ViewerError as error:
            hint = "without a screen, use --save or --headless-check"
            raise ViewerError(f"{error}; {hint}") from error


def serve_recording(path: Path, *, number: int | None = None, port: int = 9090) -> None:
    """Serve a recording to web browsers with Rerun's web viewer, until interrupted.

    The page, whose address is printed, is on `port` and takes the data from the next one.
    """
    with tempfile.TemporaryDirectory(prefix="knotflow-view-") as folder:
        rrd = save_rerun(path, Path(folder) / "recording.rrd", number=number)
        command = [rerun_program(), "--serve-web", str(rrd), "--bind", "127.0.0.1"]
        command += ["--web-viewer-port", str(port), "--port", str(port + 1)]
        data = quote(f"rerun+http://localhost:{port + 1}/proxy", safe="")
        print(f"http://localhost:{port}?url={data} (Ctrl-C ends it)", flush=True)
        quiet = {"RUST_LOG": "warn"} | os.environ  # else Rerun's log hides the address
        if subprocess.run(command, check=False, env=quiet).returncode:
            raise ViewerError(f"rerun could not serve on the ports {port} and {port + 1}")


@dataclass(frozen=True)
class HeadlessReport:
    """What Rerun reports about a recording."""

    problems: tuple[str, ...]
    entities: tuple[str, ...]
    screenshot: bytes
    """Of the whole viewer, PNG."""
    scene: bytes
    """Its 3-D view alone, PNG."""


def why_not_headless() -> str:
    """What is missing for a headless viewer here; "" when nothing is."""
    if find_spec("rerun") is None:
        return "rerun-sdk is not installed"
    if platform.system() != "Linux":
        return ""  # macOS and Windows bring Metal and DirectX
    drivers = [Path(root, "vulkan/icd.d") for root in ("/usr/share", "/etc", "/usr/local/share")]
    if not find_library("vulkan") or not any(list(place.glob("*.json")) for place in drivers):
        return "no Vulkan driver (Debian: apt-get install mesa-vulkan-drivers libvulkan1)"
    return ""


def check_recording(
    path: Path, *, number: int | None = None, at: float = 0.5, delay: float = 0.0
) -> HeadlessReport:
    """Open a recording without a window and collect what Rerun reports.

    The screenshots are taken after a `delay`, seconds, at a fraction `at` of the recording.

    Raises:
        ViewerError: no headless viewer can run here, or it did not answer.
    """
    if missing := why_not_headless():
        raise ViewerError(f"no headless viewer can run here: {missing}")
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with tempfile.TemporaryDirectory(prefix="knotflow-check-") as folder:
        rrd = save_rerun(path, Path(folder) / "recording.rrd", number=number)
        with ViewerClient.spawn(
            headless=True, port=port, executable_path=rerun_program()
        ) as viewer:
            viewer.open(str(rrd))
            state = _wait_for_views(viewer)
            (recording,) = state.recordings
            (line,) = [each for each in recording.timelines if each.name == TIMELINE]
            end = (line.end or 0) / NANOSECONDS  # a recording starts at 0
            viewer.set_time(TIMELINE, duration=at * end, play_state="paused")
            time.sleep(delay)
            scene_view = next(view for view in state.views if view.view_class == "3D")
            screenshot = viewer.take_screenshot()  # paints, so the reports below are of this time
            scene = viewer.take_screenshot(scene_view.view_id)
            state = viewer.get_state()
            schema = viewer.get_recording_schema(paths_only=True)
    entities = tuple(sorted({entity.entity_path for entity in schema.entities}))
    problems = [f"{topic} is not in the recording" for topic in _TOPICS if topic not in entities]
    for view in state.views:
        for report in view.reports:
            text = f"{report.severity}: {report.summary} {report.details or ''}"
            problems.append(textwrap.shorten(f"view {view.name!r}: {text}", _REPORT_LENGTH))
        if not view.visible:
            problems.append(f"view {view.name!r} is not visible")
    return HeadlessReport(tuple(problems), entities, screenshot, scene)


def _wait_for_views(viewer: ViewerClient) -> ViewerState:
    """The viewer's state once the recording and its blueprint are there."""
    deadline = time.monotonic() + _TIMEOUT
    while True:
        state = viewer.get_state()
        classes = {view.view_class for view in state.views}
        if not state.loading and state.recordings and classes.issuperset(_VIEWS):
            return state
        if time.monotonic() > deadline:
            raise ViewerError(
                f"after {_TIMEOUT:.0f} s Rerun shows the views {sorted(classes)}, not {_VIEWS}"
            )
        time.sleep(0.2)
