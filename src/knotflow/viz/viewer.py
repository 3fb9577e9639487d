"""Recordings in the Rerun viewer: in a window, in a browser, or as a file."""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path
from urllib.parse import quote

from knotflow.recording import load
from knotflow.recording.reader import existing_recording, recordings_in
from knotflow.viz.rerun_file import (
    ViewerError,
    no_such_number,
    rerun_program,
    run_rerun,
    save_rerun,
)


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


def open_rerun(rrd: Path) -> None:
    """Show a Rerun file in a window; returns when it is closed."""
    try:
        # An open viewer would take the file over and return before it has read it.
        run_rerun(str(rrd), "--new")
    except ViewerError as error:
        raise ViewerError(f"{error}; without a screen, use --save or --web") from error


def serve_rerun(rrd: Path, port: int = 9090) -> None:
    """Serve a Rerun file to web browsers with Rerun's web viewer, until interrupted.

    The page, whose address is printed, is on `port` and takes the data from the next one.
    """
    command = [rerun_program(), "--serve-web", str(rrd), "--bind", "127.0.0.1"]
    command += ["--web-viewer-port", str(port), "--port", str(port + 1)]
    data = quote(f"rerun+http://localhost:{port + 1}/proxy", safe="")
    print(f"http://localhost:{port}?url={data} (Ctrl-C ends it)", flush=True)
    quiet = {"RUST_LOG": "warn"} | os.environ  # else Rerun's log hides the address
    if subprocess.run(command, check=False, env=quiet).returncode:
        raise ViewerError(f"rerun could not serve on the ports {port} and {port + 1}")
