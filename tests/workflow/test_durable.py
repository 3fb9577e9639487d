"""A file is whole or not there."""

from __future__ import annotations

import errno
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from knotflow.workflow import durable
from knotflow.workflow.errors import DiskFullError


def test_appears_only_when_complete(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "a.npz"
    with durable.atomic(target) as path:
        path.write_text("new")
        assert path.suffix == ".npz"
        assert path.parent == target.parent
        assert not target.exists()
    assert target.read_text() == "new"
    assert os.listdir(target.parent) == ["a.npz"]


def test_failure_keeps_the_old_file_and_no_rest(tmp_path: Path) -> None:
    target = tmp_path / "a"
    target.write_text("old")
    with pytest.raises(RuntimeError), durable.atomic(target) as path:
        path.write_text("half")
        raise RuntimeError
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["a"]


def test_order_is_content_then_name_then_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[str] = []
    sync_entry, replace = durable.sync_entry, os.replace

    def synced(path: Path) -> None:
        steps.append(f"sync {'folder' if path.is_dir() else 'file'}")
        sync_entry(path)

    def replaced(source: Path, target: Path) -> None:
        steps.append("rename")
        replace(source, target)

    monkeypatch.setattr(durable, "sync_entry", synced)
    monkeypatch.setattr(os, "replace", replaced)
    durable.write_json(tmp_path / "a.json", {"a": 1})
    assert steps == ["sync file", "rename", "sync folder"]


def test_folders_too_and_never_a_mix(tmp_path: Path) -> None:
    for name in ("a", "b"):
        with durable.atomic(tmp_path / "folder") as path:
            path.mkdir()
            (path / name).write_text(name)
    assert os.listdir(tmp_path) == ["folder"]
    assert os.listdir(tmp_path / "folder") == ["b"]
    with durable.atomic(tmp_path / "folder") as path:
        path.write_text("a file now")
    assert (tmp_path / "folder").read_text() == "a file now"
    assert os.listdir(tmp_path) == ["folder"]


def test_a_folder_that_cannot_be_replaced_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "a").write_text("a")

    def full(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space"), durable.atomic(tmp_path / "folder") as path:
        path.mkdir()
    assert os.listdir(tmp_path) == ["folder"]
    assert os.listdir(tmp_path / "folder") == ["a"]


def test_nothing_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nothing was written"):
        with durable.atomic(tmp_path / "a"):
            pass


def test_rests_of_a_killed_process_are_removed(tmp_path: Path) -> None:
    (tmp_path / "sub" / f"{durable.TEMPORARY}1-x-folder").mkdir(parents=True)
    (tmp_path / "sub" / f"{durable.TEMPORARY}1-x-folder" / f"{durable.TEMPORARY}y").touch()
    (tmp_path / "sub" / f"{durable.TEMPORARY}1-x-file").touch()
    (tmp_path / "sub" / "kept").touch()
    durable.remove_temporaries(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["sub", "kept"]


def test_full_disk_is_seen_through_other_errors(tmp_path: Path) -> None:
    with pytest.raises(DiskFullError, match=rf"stage 'x' could not write to {tmp_path}.*goes on"):
        with durable.explain_full_disk(tmp_path, "stage 'x'"):
            try:
                raise OSError(errno.ENOSPC, "No space left on device")
            except OSError as error:
                raise RuntimeError("PytorchStreamWriter failed writing file") from error


def test_other_errors_pass_unchanged(tmp_path: Path) -> None:
    with pytest.raises(PermissionError), durable.explain_full_disk(tmp_path, "x"):
        raise PermissionError(errno.EACCES, "no")


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 256 KiB, where the tests may mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    try:
        done = subprocess.run(mount, capture_output=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no mount command")
    if done.returncode:
        pytest.skip("mounting needs root")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_really_full_disk(tiny_disk: Path) -> None:
    with pytest.raises(DiskFullError), durable.explain_full_disk(tiny_disk, "x"):
        with durable.atomic(tiny_disk / "small") as path:
            path.write_bytes(bytes(1000))
        with durable.atomic(tiny_disk / "large") as path:
            path.write_bytes(bytes(1_000_000))
    assert os.listdir(tiny_disk) == ["small"]


def test_a_disk_without_room_explains_errors_that_hide_it(tiny_disk: Path) -> None:
    (tiny_disk / "filler").write_bytes(bytes(220 * 1024))
    with pytest.raises(DiskFullError), durable.explain_full_disk(tiny_disk / "not" / "yet", "x"):
        raise RuntimeError("writer failed")
