"""Checking a recording in a Rerun viewer without a window."""

from __future__ import annotations

import platform
import socket
import tempfile
import textwrap
import time
from ctypes.util import find_library
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from knotflow.recording import topics
from knotflow.recording.schema import NANOSECONDS
from knotflow.viz.blueprint import TIMELINE
from knotflow.viz.viewer import rerun_program, save_rerun

if TYPE_CHECKING:
    import os

    from rerun.experimental import ViewerClient, ViewerState

VIEWS = ("3D", "TextLog")
SHOWN = (topics.ROPE, topics.ROPE_LINE, topics.GRIPPER, topics.SPLINE, topics.TOPOLOGY)
PATIENCE_S = 20.0
LONGEST_REPORT = 300  # Rerun spells out whole Arrow types


@dataclass(frozen=True)
class HeadlessReport:
    """What Rerun said about a recording.

    Attributes:
        problems: one line each; none means that everything is shown.
        entities: paths of what the recording holds.
        screenshot: the whole viewer in the middle of the recording, PNG.
        scene: its 3-D view alone, PNG.
    """

    problems: tuple[str, ...]
    entities: tuple[str, ...]
    screenshot: bytes
    scene: bytes


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
    path: str | os.PathLike[str],
    *,
    number: int | None = None,
    at: float = 0.5,
    settle_s: float = 0.0,
) -> HeadlessReport:
    """Open a recording without a window and see what Rerun reports.

    Args:
        path: a recording or a folder of recordings; see ``find_recording``.
        number: check only the rollout of this number.
        at: the moment to look at, as a share of the recording's duration.
        settle_s: seconds to wait before the screenshots; after about 5 Rerun's greeting notices,
            which lie over the picture, are gone.

    Raises:
        FileNotFoundError, ValueError, ViewerError: as for ``save_rerun``.
        RuntimeError: no headless viewer can run here, or it did not answer.
    """
    missing = why_not_headless()
    if missing:
        raise RuntimeError(f"no headless viewer can run here: {missing}")
    from rerun.experimental import ViewerClient

    with tempfile.TemporaryDirectory(prefix="knotflow-check-") as folder:
        rrd = save_rerun(path, Path(folder) / "recording.rrd", number=number)
        with ViewerClient.spawn(
            headless=True, port=_free_port(), executable_path=rerun_program()
        ) as viewer:
            viewer.open(str(rrd))
            state = _wait_for_views(viewer)
            (recording,) = state.recordings
            (line,) = [each for each in recording.timelines if each.name == TIMELINE]
            end = (line.end or 0) / NANOSECONDS  # a recording starts at 0
            viewer.set_time(TIMELINE, duration=at * end, play_state="paused")
            time.sleep(settle_s)
            scene_view = next(view for view in state.views if view.view_class == "3D")
            screenshot = viewer.take_screenshot()  # paints, so the reports below are of this time
            scene = viewer.take_screenshot(scene_view.view_id)
            state = viewer.get_state()
            schema = viewer.get_recording_schema(paths_only=True)
    entities = tuple(sorted({entity.entity_path for entity in schema.entities}))
    return HeadlessReport(_problems(state, entities), entities, screenshot, scene)


def _wait_for_views(viewer: ViewerClient) -> ViewerState:
    """The viewer's state once the recording and its blueprint are there."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        state = viewer.get_state()
        classes = {view.view_class for view in state.views}
        if not state.loading and state.recordings and classes.issuperset(VIEWS):
            return state
        if time.monotonic() > deadline:
            raise RuntimeError(
                f"after {PATIENCE_S:.0f} s Rerun shows the views {sorted(classes)}, not {VIEWS}"
            )
        time.sleep(0.2)


def _free_port() -> int:
    """A TCP port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _problems(state: ViewerState, entities: tuple[str, ...]) -> tuple[str, ...]:
    found = [f"{topic} is not in the recording" for topic in SHOWN if topic not in entities]
    for view in state.views:
        for report in view.reports:
            text = f"{report.severity}: {report.summary} {report.details or ''}"
            found.append(f"view {view.name!r}: {textwrap.shorten(text, LONGEST_REPORT)}")
        if not view.visible:
            found.append(f"view {view.name!r} is not visible")
    return tuple(found)
