"""An experiment that is killed now and then ends as one that never was.

    KILLS=5 python -m pytest tests/test_kills.py -s

kills it so many times, `kill -9` a random while after randomly many of its stages; without
KILLS it is left out, for it takes minutes. What is half-written at each change of the file
system is tests/workflow/test_store.py's.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

KILLS = int(os.environ.get("KILLS", "0"))
EXPERIMENT = "joint_finetuning"
"""Simulates, imitates, learns from attempts and from self-play, and plans."""
SECONDS = 1.0
"""At most so long after a stage it is killed."""

pytestmark = pytest.mark.skipif(not KILLS, reason="takes minutes: KILLS=5 runs it")


def start(results: Path) -> subprocess.Popen[bytes]:
    """The experiment in a process of its own."""
    command = [sys.executable, "-m", "knotflow", f"+experiment={EXPERIMENT}", "budget=smoke"]
    return subprocess.Popen([*command, f"results_dir={results}"], stdout=subprocess.DEVNULL)


def finished(results: Path) -> int:
    """How many stages have ended."""
    folders = (results / "stages").glob("*/*/")
    return sum((one / "stage.json").exists() for one in folders if not one.suffix)


def tables(results: Path) -> dict[str, pd.DataFrame]:
    """Every CSV of stages and results by its path, without what tells seconds."""
    found = {}
    for folder in ("stages", EXPERIMENT):
        for path in sorted((results / folder).rglob("*.csv")):
            table = pd.read_csv(path)
            untimed = [name for name in table.columns if "seconds" not in name]
            found[path.relative_to(results).as_posix()] = table[untimed]
    return found


def test_an_experiment_that_is_killed_now_and_then_ends_as_one_that_never_was(tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert start(whole).wait() == 0
    moments, kills, stages = random.Random(), 0, finished(whole)
    for kill in range(KILLS):
        after = int(stages * moments.uniform(kill, kill + 1) / KILLS)
        process = start(killed)
        while finished(killed) < after and process.poll() is None:
            time.sleep(0.02)
        try:
            assert process.wait(moments.uniform(0.0, SECONDS)) == 0  # it was faster than that
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            kills += 1
            print(f"\nkilled with {finished(killed)} stages finished", end="")
    print(f"\nkilled {kills} times, of {stages} stages")
    assert start(killed).wait() == 0
    expected, found = tables(whole), tables(killed)
    assert found.keys() == expected.keys()
    for name, table in expected.items():
        pd.testing.assert_frame_equal(found[name], table, check_exact=True, obj=name)
