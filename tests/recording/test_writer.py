from __future__ import annotations

import errno
import itertools
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

import knotflow
from knotflow.recording import read_recording, write_recording


def test_any_mcap_reader_decodes_everything(tmp_path, make_rollout):
    path = tmp_path / "new" / "folder" / "two.mcap"
    write_recording(path, [make_rollout(1), make_rollout(2)], {"stage": "test"})
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        seen: dict[str, list] = {}
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            seen.setdefault(channel.topic, []).append((message.log_time, schema.name, decoded))
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata == {"knotflow": {"stage": "test"}}
    assert {topic: (len(found), found[0][1]) for topic, found in seen.items()} == {
        "/rollout": (2, "knotflow.Rollout"),
        "/tf": (1, "foxglove.FrameTransforms"),
        "/rope/points": (52, "foxglove.PointCloud"),
        "/rope/line": (52, "foxglove.SceneUpdate"),
        "/gripper": (52, "foxglove.PoseInFrame"),
        "/spline": (2, "foxglove.SceneUpdate"),
        "/topology": (4, "foxglove.Log"),
    }
    facts = seen["/rollout"][1][2]
    assert (facts.number, facts.action, facts.outcome) == (2, "C(0,1,1)", "failure")
    assert dict(facts.extra) == {"demonstration": "2"}


def test_rollouts_share_one_timeline(tmp_path, make_rollout):
    path = tmp_path / "many.mcap"
    write_recording(path, (make_rollout(number, frames=3) for number in range(70)), {})
    with path.open("rb") as stream:
        messages = make_reader(stream).iter_messages("/rope/points", log_time_order=False)
        log_times = [message.log_time for _, _, message in messages]
    assert log_times[0] == 0
    assert all(second > first for first, second in itertools.pairwise(log_times))
    assert log_times[3] - log_times[2] < 1_000_000_000  # a short gap


def test_only_small_files_draw_the_rope_line(tmp_path, make_rollout):
    def has_line(count: int, **options: bool) -> bool:
        path = tmp_path / "recording.mcap"
        write_recording(path, (make_rollout(n, frames=2) for n in range(count)), {}, **options)
        with path.open("rb") as stream:
            return any(True for _ in make_reader(stream).iter_messages("/rope/line"))

    assert has_line(32) and not has_line(33) and not has_line(1, rope_line=False)


def test_bulk_rollout_size(tmp_path, make_rollout):
    path = tmp_path / "shard.mcap"
    write_recording(path, map(make_rollout, range(64)), {})
    assert path.stat().st_size / 64 < 15_000


def test_failing_source_leaves_old_file(tmp_path, make_rollout):
    path = tmp_path / "recording.mcap"
    write_recording(path, [make_rollout(1)], {})

    def failing():
        yield from (make_rollout(number) for number in range(40))
        raise RuntimeError("the simulator died")

    with pytest.raises(RuntimeError, match="the simulator died"):
        write_recording(path, failing(), {})
    assert [rollout.number for rollout in read_recording(path)] == [1]
    assert os.listdir(tmp_path) == ["recording.mcap"]


def test_full_disk_leaves_nothing_behind(tmp_path, make_rollout, monkeypatch):
    def full(writer: Writer) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Writer, "finish", full)
    with pytest.raises(OSError, match="No space left"):
        write_recording(tmp_path / "recording.mcap", [make_rollout(1)], {})
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_killed_writer_leaves_no_recording(tmp_path, make_rollout):
    path = tmp_path / "recording.mcap"
    program = f"""
import os, signal, numpy as np
from knotflow.recording import RecordedRollout, write_recording
def rollouts():
    for number in range(1000):
        if number == 200:
            os.kill(os.getpid(), signal.SIGKILL)
        yield RecordedRollout(np.arange(9.0), np.ones((9, 5, 3)), np.ones((9, 3)), np.ones((3, 3)),
            np.ones(6), "R1(0,1,1)", "", "", "", "failure", "s", "random", number)
write_recording({str(path)!r}, rollouts(), {{}})
"""
    source = str(Path(knotflow.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": source}
    done = subprocess.run([sys.executable, "-c", program], env=environment, check=False)
    assert done.returncode == -9
    assert list(tmp_path.glob("*.mcap")) == []
    write_recording(path, [make_rollout(1)], {})  # what the killed one left is no hindrance
    assert os.listdir(tmp_path) == ["recording.mcap"]


@pytest.mark.parametrize(
    ("numbers", "words"),
    [([], "at least one rollout"), ([4, 5, 4], "two rollouts have the number 4")],
)
def test_bad_requests_are_refused(tmp_path, make_rollout, numbers, words):
    with pytest.raises(ValueError, match=words):
        write_recording(tmp_path / "recording.mcap", map(make_rollout, numbers), {})
    assert os.listdir(tmp_path) == []
