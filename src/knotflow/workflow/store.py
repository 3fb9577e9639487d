"""Where the outputs of stages live, and when one counts as finished.

results/stages/<stage>/<signature>/           finished: it has this name only once it is complete
results/stages/<stage>/<signature>.partial/   being made, or left by an interruption
results/stages/<stage>/<signature>.lock       held by the process that makes it

Order of finishing: the outputs are forced to the disk, then stage.json (with the manifest of files
and sizes) appears in the partial folder, then the folder is renamed. So a stage.json says that the
outputs before it are whole, and a kill between any two steps is repaired by going on.
"""

from __future__ import annotations

import json
import os
import socket
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from . import durable
from .errors import DamagedStageError
from .provenance import CodeState

RECORD = "stage.json"
CLOCK = ".clock.json"  # seconds and code of earlier attempts; only in partial folders
TRACEBACK = "traceback.txt"  # of the last error that stopped it; only in partial folders


@dataclass(frozen=True)
class StageFolder:
    """The place of one stage's output."""

    results_dir: Path
    stage: str
    signature: str

    @property
    def relative(self) -> Path:
        """Below the results folder, finished."""
        return Path("stages") / self.stage / self.signature

    @property
    def final(self) -> Path:
        """The finished output."""
        return self.results_dir / self.relative

    @property
    def partial(self) -> Path:
        """The output while it is being made."""
        return self.final.with_name(f"{self.signature}.partial")

    def state(self) -> str:
        """`done`, `resume` or `run`."""
        if self.final.exists():
            return "done"
        return "resume" if self.partial.exists() else "run"

    def began(self) -> bool:
        """Whether the partial output holds anything to go on from."""
        return bool(_sizes(self.partial))

    def keep_traceback(self, error: Exception) -> Path:
        """Writes down where an error came from, on a worker too; returns the file."""
        path = self.partial / TRACEBACK
        path.write_text("".join(traceback.format_exception(error)), "utf-8")
        return path

    def record(self) -> dict[str, Any]:
        """The stage.json of the finished output, after a look whether the output is still whole.

        Raises:
            DamagedStageError: files are missing or have another size; says what to delete.
        """
        return read_record(self.final, self.stage, self.signature)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Keeps other processes from making the same output; waits, and says so, if one does.

        The kernel frees the lock of a killed process.
        """
        path = self.final.with_name(f"{self.signature}.lock")
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            print(f"  waiting for {Clock(self.partial).owner()}, which is making {self.relative}")
            lock.acquire(poll_interval=0.1)
        try:
            yield
        finally:
            lock.release()

    def finish(self, record: dict[str, Any]) -> dict[str, Any]:
        """Turns the partial folder into the finished one and returns the record with manifest.

        Raises:
            FileExistsError: the stage itself wrote a file with the record's name.
        """
        if (self.partial / RECORD).exists():
            raise FileExistsError(f"{self.stage} wrote {RECORD}, which is kept for its record")
        durable.remove_temporaries(self.partial)
        durable.sync(self.partial)
        record = record | {"files": _sizes(self.partial)}
        durable.write_json(self.partial / RECORD, record)
        self._rename()
        return record

    def recover(self) -> dict[str, Any] | None:
        """Finishes an output that was complete but for its renaming; None if there is none."""
        if not (self.partial / RECORD).exists():
            return None
        record = read_record(self.partial, self.stage, self.signature)
        self._rename()
        return record

    def _rename(self) -> None:
        for name in (CLOCK, TRACEBACK):
            (self.partial / name).unlink(missing_ok=True)
        durable.remove_temporaries(self.partial)
        durable.sync_entry(self.partial)
        os.rename(self.partial, self.final)
        durable.sync_entry(self.final.parent)


class Clock:
    """Wall time of a stage over all attempts, and the code that made it; a killed attempt counts up
    to its last save."""

    SAVE_EVERY = 2.0  # seconds; a stage with tiny shards must not spend its time on this

    def __init__(self, partial: Path, code: CodeState | None = None) -> None:
        self.path = partial / CLOCK
        known = self._read()
        self.earlier = float(known.get("seconds", 0.0))
        self.code: list[CodeState] = []
        """Of the attempts that the output comes from, this one last; empty for who only reads."""
        if code is not None:
            left = known.get("code", ()) if _sizes(partial) else ()
            self.code = [one for one in (CodeState(*one) for one in left) if one != code] + [code]
        self.started = self.saved = time.monotonic()

    def seconds(self) -> float:
        """So far, this attempt and the earlier ones."""
        return self.earlier + time.monotonic() - self.started

    def save(self) -> None:
        """Writes the time down."""
        owner = {"pid": os.getpid(), "host": socket.gethostname()}
        known = {"seconds": round(self.seconds(), 3), "code": list(map(astuple, self.code))}
        durable.write_json(self.path, known | owner)
        self.saved = time.monotonic()

    def provenance(self) -> dict[str, Any]:
        """What a record says of the code: the last `commit` and its date, whether any attempt's was
        `dirty`, and all `commits` where there are several."""
        commits = list(dict.fromkeys(one.commit for one in self.code))
        last = self.code[-1]
        record = asdict(last) | {"dirty": last.dirty or any(one.dirty for one in self.code)}
        return record | ({"commits": commits} if len(commits) > 1 else {})

    def save_sometimes(self) -> None:
        """Writes the time down if the last time is a while ago."""
        if time.monotonic() - self.saved > self.SAVE_EVERY:
            self.save()

    def owner(self) -> str:
        """Which process wrote it last, in words."""
        known = self._read()
        return f"process {known['pid']} on {known['host']}" if known else "another process"

    def _read(self) -> dict[str, Any]:
        try:
            return dict(json.loads(self.path.read_text("utf-8")))
        except FileNotFoundError:  # a first attempt
            return {}


def read_record(folder: Path, stage: str, signature: str) -> dict[str, Any]:
    """Reads and checks the stage.json of a complete output in `folder`.

    Raises:
        DamagedStageError: see `StageFolder.record`.
    """
    remedy = f"It was changed by hand. Delete {folder} and run again: it will be made anew"
    try:
        record = dict(json.loads((folder / RECORD).read_text("utf-8")))
        manifest = dict(record["files"])
    except (FileNotFoundError, ValueError, KeyError, TypeError) as error:
        raise DamagedStageError(f"{folder / RECORD} is missing or unreadable. {remedy}") from error
    if (record.get("stage"), record.get("signature")) != (stage, signature):
        raise DamagedStageError(
            f"{folder} holds {record.get('stage')}/{record.get('signature')}. {remedy}"
        )
    there = _sizes(folder)
    wrong = [
        f"{name} ({'missing' if name not in there else f'{there[name]} bytes, not {size}'})"
        for name, size in manifest.items()
        if there.get(name) != size
    ]
    if wrong:
        more = f" and {len(wrong) - 5} more" if len(wrong) > 5 else ""
        raise DamagedStageError(f"{folder} is damaged: {', '.join(wrong[:5])}{more}. {remedy}")
    return record


def _sizes(folder: Path) -> dict[str, int]:
    """Every file below `folder` but the runner's own, with its size in bytes."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    own = {folder / name for name in (RECORD, CLOCK, TRACEBACK)}
    return {
        path.relative_to(folder).as_posix(): path.stat().st_size
        for path in files
        if path not in own
    }
