"""Opening recordings in Rerun with our blueprint."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from knotflow.recording.index import recordings_in
from knotflow.recording.reader import existing_recording, read_metadata, read_recording
from knotflow.recording.scene import rope_radius
from knotflow.recording.schema import RecordedRollout
from knotflow.recording.table import load
from knotflow.recording.writer import write_recording
from knotflow.viz.blueprint import APPLICATION, TIMELINE, blueprint

if TYPE_CHECKING:
    from rerun.chunk import Chunk

LOG_TIME = "message_log_time"
"""Rerun's name for the time of an MCAP file's messages."""


class ViewerError(RuntimeError):
    """Rerun refused a recording or could not open its window."""


def open_recording(path: str | os.PathLike[str], *, number: int | None = None) -> None:
    """Show a recording in a Rerun window and return when that is closed.

    Args:
        path: a recording or a folder of recordings; see ``find_recording``.
        number: show only the rollout of this number.

    Raises:
        FileNotFoundError, ValueError: as for ``save_rerun``.
        ViewerError: the window could not be opened.
    """
    with tempfile.TemporaryDirectory(prefix="knotflow-view-") as folder:
        rrd = save_rerun(path, Path(folder) / "recording.rrd", number=number)
        # An open viewer would take the file over and let us return, and so delete it, before it
        # is read: a new one stays with us until its window is closed.
        try:
            _rerun(str(rrd), "--new")
        except ViewerError as error:
            raise ViewerError(
                f"{error}; without a screen, use --save or --headless-check"
            ) from error


def serve_recording(
    path: str | os.PathLike[str], *, number: int | None = None, port: int = 9090
) -> None:
    """Serve a recording to web browsers with Rerun's web viewer, until interrupted.

    The address is printed. Over ssh two ports are to be forwarded: `port`, where the page is, and
    the next one, from which it takes the data.

    Args:
        path, number: as for ``open_recording``.
        port: of the page.

    Raises:
        FileNotFoundError, ValueError: as for ``save_rerun``.
        ViewerError: it could not be served, such as on a port that is taken.
    """
    with tempfile.TemporaryDirectory(prefix="knotflow-view-") as folder:
        rrd = save_rerun(path, Path(folder) / "recording.rrd", number=number)
        command = [rerun_program(), "--serve-web", str(rrd), "--bind", "127.0.0.1"]
        command += ["--web-viewer-port", str(port), "--port", str(port + 1)]
        data = quote(f"rerun+http://localhost:{port + 1}/proxy", safe="")
        print(f"http://localhost:{port}?url={data} (Ctrl-C ends it)", flush=True)
        quiet = {"RUST_LOG": "warn"} | os.environ  # else the address drowns in what Rerun logs
        code = subprocess.run(command, check=False, env=quiet).returncode
        if code:
            raise ViewerError(f"rerun could not serve on the ports {port} and {port + 1}")


def save_rerun(
    path: str | os.PathLike[str], target: str | os.PathLike[str], *, number: int | None = None
) -> Path:
    """Write a recording and our blueprint as one ``.rrd`` that ``rerun`` shows as it is.

    The rollouts are read and written again on the way: so one of them can be picked, and bulk
    data get their rope line.

    Returns:
        The file written.

    Raises:
        FileNotFoundError: the recording, or a recording in the folder, is not there.
        NotARecordingError, DamagedRecordingError: the file is no recording, or cut or changed.
        ValueError: no rollout has this number.
        ViewerError: Rerun could not convert it.
    """
    source = find_recording(path, number)
    with tempfile.TemporaryDirectory(prefix="knotflow-view-") as temporary:
        folder = Path(temporary)
        mcap, plain, layout = folder / "view.mcap", folder / "view.rrd", folder / "view.rbl"
        radii: list[float] = []
        cameras: list[bool] = []
        chosen = _measured(_chosen(source, number), radii, cameras)
        write_recording(mcap, chosen, read_metadata(source), rope_line=True)
        _convert(mcap, plain, source.stem if number is None else f"{source.stem}#{number}")
        blueprint(radii[0], camera=any(cameras)).save(APPLICATION, layout)
        _rerun("rrd", "merge", str(plain), str(layout), "-o", str(target))
    return Path(target)


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
        raise ValueError(_no_such_number(place, number, table["number"].tolist()))
    if len(files) > 1:
        raise ValueError(f"rollout {number} is in several recordings, name one: {files}")
    return Path(files[0])


def rerun_program() -> str:
    """Path of Rerun's command, which need not be on PATH: it lies beside our Python.

    Raises:
        ViewerError: Rerun is not installed.
    """
    program = shutil.which("rerun", path=sysconfig.get_path("scripts")) or shutil.which("rerun")
    if program is None:
        raise ViewerError("the Rerun viewer is not installed; pip install rerun-sdk brings it")
    return program


def _chosen(source: Path, number: int | None) -> Iterator[RecordedRollout]:
    seen = []
    found = False
    for rollout in read_recording(source):
        seen.append(rollout.number)
        if number is None or rollout.number == number:
            found = True
            yield rollout
    if not found and number is not None:
        raise ValueError(_no_such_number(source, number, seen))


def _measured(
    rollouts: Iterator[RecordedRollout], radii: list[float], cameras: list[bool]
) -> Iterator[RecordedRollout]:
    """The same rollouts, while the radii of their ropes, m, and who was seen are noted."""
    for rollout in rollouts:
        radii.append(rope_radius(rollout.control_points))
        cameras.append(rollout.camera is not None)
        yield rollout


def _convert(source: Path, target: Path, name: str) -> None:
    """Write a recording as Rerun reads it, under a name, with the one timeline `TIMELINE`."""
    from rerun.chunk import McapReader

    stream = McapReader(source, timeline_type="duration_ns").stream()  # from 0 s, not from 1970
    stream.flat_map(_timed).write_rrd(target, application_id=APPLICATION, recording_id=name)


def _timed(chunk: Chunk) -> list[Chunk]:
    """A chunk's rows by the time of the rollout alone; Rerun's reader offers others, too."""
    import pyarrow as pa
    from rerun.chunk import Chunk

    if chunk.is_static:
        return [chunk]
    others = [name for name in chunk.timeline_names if name != LOG_TIME]
    batch = chunk.to_record_batch().drop_columns(others)
    column = batch.schema.get_field_index(LOG_TIME)
    old = batch.schema.field(column)
    new = old.with_name(TIMELINE).with_metadata(
        (old.metadata or {}) | {b"rerun:index_name": TIMELINE.encode()}
    )
    schema = batch.schema.set(column, new)
    return Chunk.from_record_batch(pa.RecordBatch.from_arrays(batch.columns, schema=schema))


def _no_such_number(place: Path, number: int, numbers: list[int]) -> str:
    there = f"{len(numbers)} rollouts from {min(numbers)} to {max(numbers)}" if numbers else "none"
    return f"{place} has no rollout number {number}; there are {there}"


def _rerun(*arguments: str) -> None:
    """Run Rerun's command line and wait for it."""
    command = [rerun_program(), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ViewerError(
            f"rerun {' '.join(arguments)} failed with code {done.returncode}: "
            + _last_error(done.stderr)
        )


def _last_error(log: str) -> str:
    """The line that says what went wrong, without what Rerun reports of its own working."""
    lines = [line for line in log.splitlines() if line.strip()]
    return next((line for line in reversed(lines) if "rror" in line), "\n".join(lines[-3:]))
