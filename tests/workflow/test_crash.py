"""Killed at any moment, or with a full disk: nothing half-written counts, nothing finished is lost.

`kill -9` is done for real: on another process at random moments, and on forked copies of this one
at every single change of the file system.
"""

from __future__ import annotations

import errno
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from knotflow.workflow import DiskFullError

SHARDS = 60
CHANGES = {"os.rename", "os.mkdir", "os.remove", "os.rmdir", "toy.between"}
Go = Callable[..., Path]


def content(folder: Path) -> dict[str, bytes]:
    """Every file of outputs and results but the records, which tell times."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix not in (".json", ".lock")
    }


def start(folder: Path) -> subprocess.Popen[bytes]:
    """The slow workflow in a process of its own."""
    source = str(Path(__file__).parents[2] / "src")
    return subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("killable.py")), str(folder), str(SHARDS)],
        env=os.environ | {"PYTHONPATH": source},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@pytest.mark.slow
def test_killed_at_random_moments(tmp_path: Path) -> None:
    moments = random.Random(0)
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    finished: dict[str, tuple[int, int]] = {}

    def shards() -> dict[str, tuple[int, int]]:
        paths = list(killed.glob("stages/toy_slow/*/[0-9]*.txt"))  # once: more may appear
        return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in paths}

    for _ in range(4):
        process = start(killed)
        while process.poll() is None and len(shards()) <= len(finished):
            time.sleep(0.002)  # it has begun to work
        time.sleep(moments.uniform(0.0, 0.08))
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        assert not list(killed.glob("killable/*"))
        assert len(list(killed.glob("stages/toy_slow/*.partial"))) == 1
        now = shards()
        assert finished.items() <= now.items()  # untouched: not lost, not made again
        assert len(now) > len(finished)
        finished = now
    assert start(killed).wait() == 0
    assert finished.items() <= shards().items()
    assert start(whole).wait() == 0
    assert content(killed) == content(whole)
    assert len(shards()) == SHARDS


class Crash:
    """From its n-th change of the file system on, something happens to a forked process."""

    def __init__(self, moment: int, happens: Callable[[], None]) -> None:
        self.left, self.happens = moment, happens

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """An audit hook: Python calls it before each file is opened, renamed, removed, ..."""
        opened = event == "open" and isinstance(arguments[2], int) and arguments[2] & os.O_CREAT
        if event in CHANGES or opened:
            self.left -= 1
            if self.left < 0:
                self.happens()


def in_fork(work: Callable[[], int]) -> int:
    """The exit code of `work` in a forked copy of this process; minus the signal if killed."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def kill_self() -> None:
    """As `kill -9`."""
    os.kill(os.getpid(), signal.SIGKILL)


def disk_full() -> None:
    """As the file system would."""
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.fixture
def audited(
    between: Callable[..., None], mapping: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> dict[str, Any]:
    """The toy workflow, small, where the middle of a shard is a moment to crash too."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)  # a kill, unlike a power cut,
    # loses nothing that was written; hundreds of runs would wait for the disk
    between(lambda: sys.audit("toy.between"))
    mapping["stages"]["toy_count"]["config"]["shards"] = 2
    return mapping


@pytest.mark.slow
def test_killed_before_each_change_of_the_file_system(
    go: Go, audited: dict[str, Any], tmp_path: Path
) -> None:
    whole = content(go(audited, results_dir=tmp_path / "whole").parent)
    for moment in range(1000):

        def die(moment: int = moment) -> int:
            sys.addaudithook(Crash(moment, kill_self))
            go(audited, results_dir=tmp_path / str(moment))
            return 0

        code = in_fork(die)
        results = tmp_path / str(moment)
        for table in results.glob("toy/run.json"):
            assert content(table.parent) == content(tmp_path / "whole" / "toy")
        for record in results.glob("stages/*/*[!.partial]/stage.json"):
            there = {
                f"{record.parent.relative_to(results)}/{name}" for name in content(record.parent)
            }
            assert all(content(results)[name] == whole[name] for name in there)
        go(audited, results_dir=results)
        assert content(results) == whole, f"killed before change {moment}"
        assert not list(results.rglob("*.partial"))
        if code == 0:
            break
        assert code == -signal.SIGKILL
    assert moment > 20  # there were so many moments to try


@pytest.mark.slow
def test_disk_full_from_each_change_on(go: Go, audited: dict[str, Any], tmp_path: Path) -> None:
    whole = content(go(audited, results_dir=tmp_path / "whole").parent)
    for moment in range(1000):
        results = tmp_path / str(moment)

        def run_full(results: Path = results, moment: int = moment) -> int:
            sys.addaudithook(Crash(moment, disk_full))
            try:
                go(audited, results_dir=results)
            except DiskFullError as error:
                named = str(results) in str(error)
                return 28 if named and "goes on from where it stopped" in str(error) else 1
            return 0

        code = in_fork(run_full)
        go(audited, results_dir=results)
        assert content(results) == whole, f"full before change {moment}"
        if code == 0:
            break
        assert code == 28
    assert moment > 20


@pytest.mark.slow
def test_killed_while_replacing_results(go: Go, audited: dict[str, Any], tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    go(audited, results_dir=whole)
    audited["stages"]["adding"]["config"]["offset"] = 9.0
    go(audited, results_dir=whole, overwrite=True)
    for moment in range(1000):
        results = tmp_path / str(moment)
        audited["stages"]["adding"]["config"]["offset"] = 0.5
        go(audited, results_dir=results)
        audited["stages"]["adding"]["config"]["offset"] = 9.0
        go(audited, results_dir=results, experiment="other")  # the stages are finished

        def die(results: Path = results, moment: int = moment) -> int:
            sys.addaudithook(Crash(moment, kill_self))
            go(audited, results_dir=results, overwrite=True)
            return 0

        code = in_fork(die)
        told = (results / "toy" / "run.json").exists()
        table = (results / "toy" / "sum.csv").read_text()
        config = (results / "toy" / "config.yaml").read_text()
        assert not told or ("9.0" in config) == (float(table.split()[1]) == 12.0)
        go(audited, results_dir=results, overwrite=True)
        assert content(results / "toy") == content(whole / "toy")
        if code == 0:
            break
    assert moment > 5
