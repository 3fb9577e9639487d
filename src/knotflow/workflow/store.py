"""Where outputs of stages are, and when one counts as finished.

    results/stages/<stage>/<key>/           finished: it has this name only once it is complete
    results/stages/<stage>/<key>.partial/   being made, or left by an interruption
    results/stages/<stage>/<key>.lock       held by the process that makes it

Every file appears by renaming, and a finished folder too, so a kill at any time costs no more than
what was being written. Recordings of a finished folder may be deleted, unless a stage reads them or
they are results.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

RECORD = "stage.json"
CLOCK = ".seconds"  # of earlier attempts; only in partial folders
ROWS = "rows"  # of a table, until it is finished
RECORDINGS = "recordings/"
TEMPORARY = ".tmp-"


class DamagedStageError(RuntimeError):
    """The finished output of a stage was changed."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, for a file or a folder; it becomes `path` on leaving.

    The temporary name ends like `path`, so writers that look at the suffix behave.

    Raises:
        FileNotFoundError: nothing was written to the temporary path.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    token = f"{TEMPORARY}{os.getpid()}-{secrets.token_hex(4)}"
    temporary, old = path.parent / f"{token}-{path.name}", path.parent / f"{token}.old"
    try:
        yield temporary
        if temporary.exists() and (path.is_dir() or (temporary.is_dir() and path.exists())):
            os.rename(path, old)  # a folder is replaced in two steps
        os.replace(temporary, path)
    except BaseException:
        if old.exists() and not path.exists():
            os.rename(old, path)
        raise
    finally:
        remove(temporary)
        remove(old)


def write_json(path: Path, content: Any) -> None:
    """Write plain data as readable JSON, whole or not at all."""
    with atomic(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", "utf-8")


def remove(path: Path) -> None:
    """Delete a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def remove_abandoned(folder: Path) -> None:
    """Delete what processes that are gone left half-written in `folder` or below."""
    for path in list(folder.rglob(f"{TEMPORARY}*")):
        pid = path.name.removeprefix(TEMPORARY).partition("-")[0]
        if not pid.isdigit() or int(pid) == os.getpid() or not _is_alive(int(pid)):
            remove(path)


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        pass
    return True


@contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold a lock file; False if another process has it. A killed process frees it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        yield False
        return
    try:
        yield True
    finally:
        lock.release()


@dataclass(frozen=True)
class StageFolder:
    """The place of one output."""

    results_dir: Path
    stage: str
    key: str

    @property
    def relative(self) -> str:
        """Below the results folder, finished."""
        return f"stages/{self.stage}/{self.key}"

    @property
    def final(self) -> Path:
        """The finished output."""
        return self.results_dir / self.relative

    @property
    def partial(self) -> Path:
        """The output while it is being made."""
        return self.final.with_name(f"{self.key}.partial")

    def state(self) -> str:
        """`done`, `resume` or `run`."""
        return "done" if self.final.exists() else "resume" if self.partial.exists() else "run"

    def lock(self) -> Any:
        """Keeps other processes from making the same output; see `locked`."""
        return locked(self.final.with_name(f"{self.key}.lock"))

    def record(self) -> dict[str, Any]:
        """What `finish` recorded.

        Raises:
            DamagedStageError: files are missing or have another size; says what to delete.
        """
        try:
            record = dict(json.loads((self.final / RECORD).read_text("utf-8")))
            kept = {
                (name, size)
                for name, size in record["files"].items()
                if not name.startswith(RECORDINGS) or (self.final / name).exists()
            }
            wrong = dict(kept ^ sizes(self.final).items())
        except (FileNotFoundError, ValueError, KeyError):
            wrong = {RECORD: 0}
        if wrong:
            raise DamagedStageError(
                f"{self.final} was changed by hand ({', '.join(sorted(wrong)[:5])}); delete the "
                "folder and run again to make it once more"
            )
        return record

    def finish(self, record: Mapping[str, Any]) -> dict[str, Any]:
        """Turn the partial folder into the finished one; returns the record with all files."""
        remove_abandoned(self.partial)
        (self.partial / CLOCK).unlink(missing_ok=True)
        remove(self.partial / ROWS)
        complete = {**record, "files": sizes(self.partial)}
        write_json(self.partial / RECORD, complete)
        os.rename(self.partial, self.final)
        return complete


def sizes(folder: Path) -> dict[str, int]:
    """Bytes of every file below a folder but the record."""
    return {
        path.relative_to(folder).as_posix(): path.stat().st_size
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in (RECORD, CLOCK)
    }
