"""The peak of a stage's memory, and of what it started."""

import subprocess
import sys
import time

import pytest

from knotflow.workflow.memory import PeakMemory

MEGABYTES = 200


@pytest.mark.slow
def test_what_was_freed_again_counts():
    with PeakMemory() as before:
        pass
    with PeakMemory() as peak:
        held = bytearray(b"x" * (MEGABYTES * 10**6))
        time.sleep(1.2)  # longer than from one look to the next
        del held
    assert peak.megabytes > before.megabytes + 0.9 * MEGABYTES


@pytest.mark.slow
def test_what_it_started_counts_as_well():
    hold = f"held = b'x' * ({MEGABYTES} * 10**6); input()"
    with PeakMemory() as peak:
        with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE) as other:
            time.sleep(1.5)
            other.communicate(b"\n")
    with PeakMemory() as after:
        pass
    assert peak.megabytes > after.megabytes + 0.9 * MEGABYTES
