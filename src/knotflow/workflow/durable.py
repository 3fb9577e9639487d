"""Files that are either whole or not there, whatever is killed, crashes or runs full.

A file is written under another name, forced to the disk, then renamed; the folder's entry is forced
to the disk too. Names that start with `TEMPORARY` are never part of a result.
"""

from __future__ import annotations

import errno
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import DiskFullError

TEMPORARY = ".tmp-"
FULL = {errno.ENOSPC, errno.EDQUOT}
UNWRITABLE = {errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOENT, errno.ENOTDIR}
"""A folder that cannot be written to; the free bytes of some, such as /proc, are 0 as well."""
NO_ROOM = 64 * 1024  # bytes; less than that free is a full disk to any file format used here


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Gives a temporary path in the folder of `path`; on leaving, what lies there becomes `path`.

    The temporary name ends like `path`, so writers that look at the suffix behave. It may be filled
    with a file or with a folder. An older file is replaced in one step. Where a folder is involved
    there is a moment without either, so a kill may leave nothing, but never a half of one or a mix.
    Nothing is left behind when the block raises.

    Raises:
        FileNotFoundError: the block wrote nothing to the temporary path.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    token = f"{TEMPORARY}{os.getpid()}-{secrets.token_hex(4)}"
    temporary, old = path.parent / f"{token}-{path.name}", path.parent / f"{token}-old"
    try:
        yield temporary
        if not temporary.exists():
            raise FileNotFoundError(f"nothing was written to {temporary}, meant to be {path}")
        sync(temporary)
        if path.is_dir() or (temporary.is_dir() and path.exists()):
            os.rename(path, old)
        os.replace(temporary, path)
    except BaseException:
        remove(temporary)
        if old.exists() and not path.exists():
            os.rename(old, path)
        raise
    sync_entry(path.parent)
    remove(old)


def write_json(path: Path, content: Any) -> None:
    """Writes plain data as readable JSON, whole or not at all."""
    with atomic(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", "utf-8")


def sync(path: Path) -> None:
    """Forces a file, or a folder with all that is in it, to the disk."""
    if path.is_dir():
        for child in path.iterdir():
            sync(child)
    sync_entry(path)


def sync_entry(path: Path) -> None:
    """Forces one file's content or one folder's list of names to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove(path: Path) -> None:
    """Deletes a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def remove_temporaries(folder: Path) -> None:
    """Deletes what a killed process left half-written in `folder` or below."""
    for path in list(folder.rglob(f"{TEMPORARY}*")):
        remove(path)


@contextmanager
def explain_full_disk(folder: Path, work: str) -> Iterator[None]:
    """Turns the failure of a block that ran out of disk into a `DiskFullError` that helps.

    Libraries hide ENOSPC behind errors of their own (torch.save: RuntimeError), so the chain of
    causes is searched, and then the disk asked.

    Raises:
        DiskFullError: names `folder` and `work`, and says that a rerun goes on.
    """
    try:
        yield
    except DiskFullError:
        raise
    except Exception as error:
        if not _caused_by(error, FULL) and (_caused_by(error, UNWRITABLE) or not _is_full(folder)):
            raise
        raise DiskFullError(
            f"the disk is full: {work} could not write to {folder}. Nothing half-written is taken "
            "for finished; make room and run the same command again, it goes on from where it "
            "stopped"
        ) from error


def _caused_by(error: BaseException | None, numbers: set[int]) -> bool:
    while error is not None:
        if isinstance(error, OSError) and error.errno in numbers:
            return True
        error = error.__cause__ or error.__context__
    return False


def _is_full(folder: Path) -> bool:
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free < NO_ROOM
