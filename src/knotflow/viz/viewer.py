"""Recordings in the Rerun viewer: in a window, in a browser, or as a file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from knotflow.recording import RecordedRollout, load, messages, read_recording
from knotflow.recording.reader import existing_recording, recordings_in
from knotflow.simulation import spline_path

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

APPLICATION = "knotflow"
"""Rerun applies a blueprint to the recordings of the same application."""
TIMELINE = "time"
"""Seconds of a recording."""
PORT = 9090
"""Of the page in a browser."""
GAP = 0.5  # seconds between two rollouts
_LEVELS = {"success": "INFO", "failure": "WARN", "diverged": "ERROR"}


class ViewerError(RuntimeError):
    """Rerun failed, or could not open its window."""


def show(
    recording: Path, number: int | None = None, save: Path | None = None, web: bool = False
) -> None:
    """Show a recording; the arguments are those of `knotflow view`.

    Raises:
        OSError, ValueError: no such recording, or a damaged one.
        ViewerError: no viewer can be opened.
    """
    source = find_recording(recording, number)
    if recording.is_dir() and len(files := recordings_in(recording)) > 1:
        names = ", ".join(file.name for file in files)
        print(f"showing {source.name} of {len(files)} recordings: {names}")
    with tempfile.TemporaryDirectory(prefix="knotflow-view-") as folder:
        target = save or Path(folder) / "recording.rrd"
        rrd = save_rerun(source, target, number=number)
        if save is not None:
            print(f"saved {rrd}")
        if web:
            serve_rerun(rrd)
        elif save is None:
            open_rerun(rrd)


def find_recording(path: str | os.PathLike[str], number: int | None = None) -> Path:
    """The one recording that a path and a rollout number mean.

    A file means itself. In a folder it is the file that holds the number, or without a number
    the first file by name. Raises as `load`, and ValueError unless one rollout has this number.
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


def open_rerun(rrd: Path) -> None:
    """Show a Rerun file in a window; returns when it is closed.

    Raises:
        ViewerError: it could not be opened; quotes the line that names the error.
    """
    # An open viewer would take the file over and return before it has read it.
    command = [rerun_program(), str(rrd), "--new"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        why = next((line for line in reversed(lines) if "rror" in line), "\n".join(lines[-3:]))
        raise ViewerError(f"{' '.join(command)}: {why}; without a screen, use --save or --web")


def serve_rerun(rrd: Path) -> None:
    """Serve a Rerun file to web browsers with Rerun's web viewer, until interrupted.

    The page, whose address is printed, is on `PORT` and takes the data from the next one.
    """
    command = [rerun_program(), "--serve-web", str(rrd), "--bind", "127.0.0.1"]
    command += ["--web-viewer-port", str(PORT), "--port", str(PORT + 1)]
    data = quote(f"rerun+http://localhost:{PORT + 1}/proxy", safe="")
    print(f"http://localhost:{PORT}?url={data} (Ctrl-C ends it)", flush=True)
    quiet = {"RUST_LOG": "warn"} | os.environ  # else Rerun's log hides the address
    if subprocess.run(command, check=False, env=quiet).returncode:
        raise ViewerError(f"rerun could not serve on the ports {PORT} and {PORT + 1}")


def save_rerun(
    path: str | os.PathLike[str], target: str | os.PathLike[str], *, number: int | None = None
) -> Path:
    """Write the rollouts of a recording, or the one of a number, and our blueprint as one ``.rrd``
    that ``rerun`` opens as it is. Raises as `read_recording`, ValueError where no rollout has
    this number or the target is no ``.rrd``, and OSError where it cannot be written.
    """
    import rerun as rr

    source, rrd = Path(path), Path(target)
    if rrd.suffix != ".rrd":
        raise ValueError(f"{rrd}: a Rerun file ends in .rrd")
    every = [*read_recording(source)]
    chosen = [rollout for rollout in every if number in (None, rollout.number)]
    if not chosen:
        raise ValueError(no_such_number(source, number, [rollout.number for rollout in every]))
    name = source.stem if number is None else f"{source.stem}#{number}"
    rrd.parent.mkdir(parents=True, exist_ok=True)
    with rr.RecordingStream(APPLICATION, recording_id=name) as stream:
        stream.set_log_time_enabled(False)
        stream.set_log_tick_enabled(False)
        try:
            stream.save(rrd, blueprint(any(rollout.camera is not None for rollout in chosen)))
        except RuntimeError as error:  # Rerun's, of a file that cannot be made
            raise OSError(str(error)) from error
        radius = messages.rope_radius(chosen[0].control_points)
        _log_looks(stream, chosen[0].points.shape[1], radius)
        start = 0.0
        for rollout in chosen:
            start = _log_rollout(stream, rollout, start) + GAP
    return rrd


def no_such_number(path: Path, number: int | None, numbers: list[int]) -> str:
    """That a recording has no such rollout, in words."""
    there = f"{len(numbers)} rollouts from {min(numbers)} to {max(numbers)}" if numbers else "none"
    return f"{path} has no rollout number {number}; there are {there}"


def rerun_program() -> str:
    """Path of Rerun's command, which need not be on PATH: it lies beside our Python."""
    program = shutil.which("rerun", path=sysconfig.get_path("scripts")) or shutil.which("rerun")
    if program is None:
        raise ViewerError("the Rerun viewer is not installed; pip install rerun-sdk brings it")
    return program


def blueprint(camera: bool = False) -> rrb.Blueprint:
    """The layout of a recording; with `camera`, images, estimate and reference beside the rope."""
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

    contents = [messages.ROPE, messages.ROPE_LINE, messages.GRIPPER, messages.SPLINE]
    name = (
        "Rope (head blue, tail orange), gripper (yellow), spline (green) and its control points "
        "(pink), table (10 cm grid)"
    )
    if camera:
        contents += [messages.ESTIMATE, messages.REFERENCE]
        name += ", estimate (white), reference (violet)"
    scene = rrb.Spatial3DView(
        origin="/",
        name=name,
        contents=contents,
        background=rrb.Background(color=(24, 26, 30)),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.1),  # the table, z = 0
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(0.0, -0.52, 0.54),
            look_target=(0.0, 0.02, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    image = rrb.Spatial2DView(origin=messages.CAMERA, name="Camera")
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(scene, image) if camera else scene,
            rrb.TextLogView(
                origin=messages.TOPOLOGY,
                name="Topology and outcome",
                columns=rrb.TextLogColumns(
                    timeline_columns=[TimelineColumn(TIMELINE)],
                    text_log_columns=[TextLogColumn("LogLevel"), TextLogColumn("Body")],
                ),
            ),
            row_shares=[4, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _log_looks(stream: rr.RecordingStream, vertices: int, radius: float) -> None:
    """Colours and sizes of a rope of a radius, metres, and of what is around it."""
    import rerun as rr

    points, lines = rr.Points3D.from_fields, rr.LineStrips3D.from_fields
    spline = lines(radii=[0.0025, 0.001], colors=[messages.SPLINE_RGB, messages.CONTROL_RGB])
    looks = (
        (messages.ROPE, points(radii=radius, colors=messages.gradient(vertices))),
        (messages.ROPE_LINE, lines(radii=radius, colors=messages.gradient(vertices - 1))),
        (messages.GRIPPER, points(radii=0.018, colors=messages.GRIPPER_RGB)),
        (messages.SPLINE, spline),
        (messages.SPLINE, points(radii=0.01, colors=messages.CONTROL_RGB, show_labels=True)),
        (messages.ESTIMATE, points(radii=0.004, colors=(255, 255, 255))),
        (messages.REFERENCE, points(radii=0.004, colors=(204, 121, 167))),
    )
    for topic, look in looks:
        stream.log(topic, look, static=True, strict=True)


def _log_rollout(stream: rr.RecordingStream, rollout: RecordedRollout, start: float) -> float:
    """Log a rollout from a time of the recording on, seconds; returns its end there."""
    import rerun as rr

    times = rollout.times - rollout.times[0] + start
    moments = [rr.TimeColumn(TIMELINE, duration=times)]

    def log(topic: str, what: rr.AsComponents, time: float = start) -> None:
        stream.set_time(TIMELINE, duration=time)
        stream.log(topic, what, strict=True)

    def send_points(topic: str, places: NDArray) -> None:
        """Points of every frame (T, N, 3), metres."""
        columns = rr.Points3D.columns(positions=places.reshape(-1, 3))
        stream.send_columns(topic, moments, columns.partition([places.shape[1]] * len(times)))

    send_points(messages.ROPE, rollout.points)
    links = np.stack((rollout.points[:, :-1], rollout.points[:, 1:]), axis=2)  # (T, V - 1, 2, 3)
    strips = rr.LineStrips3D.columns(strips=links.reshape(-1, 2, 3))
    strips = strips.partition([links.shape[1]] * len(times))
    stream.send_columns(messages.ROPE_LINE, moments, strips)
    send_points(messages.GRIPPER, rollout.gripper[:, None])
    controls = rollout.control_points
    curve = spline_path(controls, np.linspace(0.0, 1.0, 33))
    log(messages.SPLINE, rr.LineStrips3D([curve, controls]))
    log(messages.SPLINE, rr.Points3D(controls, labels=["grasp", "middle", "end"]))
    log(messages.ROLLOUT, rr.AnyValues(**{name: getattr(rollout, name) for name in messages.TEXTS}))
    if (camera := rollout.camera) is not None:
        send_points(messages.ESTIMATE, camera.points)
        if camera.reference is not None:
            send_points(messages.REFERENCE, camera.reference)
        for time, image in zip(times, camera.images, strict=True):
            kind = f"image/{messages.image_message(0, image).format}"
            log(messages.CAMERA, rr.EncodedImage(contents=image, media_type=kind), time)
    begun, ended = messages.start_message(0, rollout), messages.end_message(0, rollout)
    log(messages.TOPOLOGY, rr.TextLog(begun.message, level="INFO"))
    log(messages.TOPOLOGY, rr.TextLog(ended.message, level=_LEVELS[rollout.outcome]), times[-1])
    return float(times[-1])
