"""Killed at random moments: nothing half-written counts, nothing finished is lost."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SHARDS = 60


def start(folder):
    """The slow workflow in a process of its own."""
    source = str(Path(__file__).parents[2] / "src")
    return subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("killable.py")), str(folder), str(SHARDS)],
        env=os.environ | {"PYTHONPATH": source},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def content(folder):
    """Every file of outputs and results but the records, which tell times."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix not in (".json", ".lock")
    }


@pytest.mark.slow
def test_kill_costs_no_finished_shard(tmp_path):
    moments = random.Random(0)
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    finished = {}

    def shards():
        paths = list(killed.glob("stages/toy_slow/*/[0-9]*.txt"))  # once: more may appear
        return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in paths}

    for _ in range(3):
        process = start(killed)
        while process.poll() is None and len(shards()) <= len(finished):
            time.sleep(0.002)  # it has begun to work
        time.sleep(moments.uniform(0.0, 0.08))
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        assert not list(killed.glob("killable/*"))
        now = shards()
        assert finished.items() <= now.items()  # not lost, not made again
        finished = now
    assert start(killed).wait() == 0
    assert finished.items() <= shards().items()
    assert start(whole).wait() == 0
    assert content(killed) == content(whole)
    assert len(shards()) == SHARDS
