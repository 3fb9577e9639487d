from __future__ import annotations

import warnings

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from knotflow.recording import (
    NotARecordingError,
    TruncatedRecordingWarning,
    read_metadata,
    read_recording,
    write_recording,
)

COUNT = 40  # more than one batch of facts


@pytest.fixture
def rollouts(make_rollout):
    return [make_rollout(number, frames=4 + number % 3) for number in range(COUNT)]


@pytest.fixture
def recording(tmp_path, rollouts):
    path = tmp_path / "recording.mcap"
    write_recording(path, rollouts, {"stage": "test", "config": "a: 1\n"})
    return path


def read_damaged(path) -> tuple[list, TruncatedRecordingWarning]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = list(read_recording(path))
    (warning,) = caught
    assert isinstance(warning.message, TruncatedRecordingWarning)
    return found, warning.message


def test_round_trip_is_exact_and_silent(recording, rollouts, assert_same):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for written, read in zip(rollouts, read_recording(recording), strict=True):
            assert_same(written, read)
    assert read_metadata(recording) == {"stage": "test", "config": "a: 1\n"}


def test_round_trip_of_extremes(tmp_path, make_rollout, assert_same):
    ropes = [
        make_rollout(1, frames=1, vertices=2),
        make_rollout(2, vertices=130, extra={}),
        make_rollout(3, times=-5.0 + np.arange(26) * 1e-9),
        make_rollout(4, outcome="diverged", points=np.full((26, 41, 3), np.nan), end_state=""),
        make_rollout(2**40, action="", source="é", signature="x" * 1000),
    ]
    write_recording(tmp_path / "r.mcap", ropes, {})
    for written, read in zip(ropes, read_recording(tmp_path / "r.mcap"), strict=True):
        assert_same(written, read)


def test_a_cut_file_gives_every_whole_rollout_before_the_cut(recording, rollouts, assert_same):
    whole = recording.read_bytes()
    with recording.open("rb") as stream:
        data_end = max(
            chunk.chunk_start_offset + chunk.chunk_length
            for chunk in make_reader(stream).get_summary().chunk_indexes
        )
    before = 0
    for cut in [*range(0, len(whole), len(whole) // 60), len(whole) - 1]:
        recording.write_bytes(whole[:cut])
        found, warning = read_damaged(recording)
        for written, read in zip(rollouts, found, strict=False):
            assert_same(written, read)
        assert len(found) >= before
        before = len(found)
        assert warning.byte <= cut and warning.rollouts_read == len(found)
        assert len(found) == COUNT if cut >= data_end else len(found) < COUNT
        # Of rollouts whose facts lie behind the cut nothing is known.
        assert warning.rollouts_lost in {0, 32 - len(found), COUNT - len(found)}
        assert warning.messages_lost >= 2 * 4 * warning.rollouts_lost
        assert f"byte {warning.byte}: " in str(warning)
        assert f"{len(found)} rollouts were read whole" in str(warning)
    assert before == COUNT


def test_a_cut_inside_a_chunk_loses_only_the_rollouts_after_it(tmp_path, make_rollout):
    path = tmp_path / "one_chunk.mcap"
    write_recording(path, map(make_rollout, range(30)), {})  # about 500 KB in one chunk
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found, warning = read_damaged(path)
    assert 5 <= len(found) <= 15
    assert warning.rollouts_lost == 30 - len(found)


def test_flipped_bytes_never_give_a_wrong_trajectory(recording, rollouts):
    whole = recording.read_bytes()
    rng = np.random.default_rng(0)
    lossy = 0
    for place in rng.integers(8, len(whole), 60):
        damaged = bytearray(whole)
        damaged[place] ^= int(rng.integers(1, 256))
        recording.write_bytes(damaged)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = list(read_recording(recording))
        for read in found:
            np.testing.assert_array_equal(read.points, rollouts[read.number].points)
        assert caught or len(found) == COUNT
        lossy += len(found) < COUNT
    assert lossy > 30


def test_rollouts_after_a_damaged_chunk_are_still_read(recording):
    """Even after the first chunk, which names the topics; the summary names them again."""
    with recording.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    whole = recording.read_bytes()
    for chunk, lost in ((chunks[0], range(32)), (chunks[1], range(32)), (chunks[2], range(32, 40))):
        damaged = bytearray(whole)
        damaged[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 255
        recording.write_bytes(damaged)
        found, warning = read_damaged(recording)
        assert {rollout.number for rollout in found} == set(range(COUNT)) - set(lost)
        assert warning.byte == chunk.chunk_start_offset
        assert warning.messages_lost > 0


def test_errors_come_at_the_call_and_say_what_is_there(tmp_path, recording):
    with pytest.raises(FileNotFoundError, match="not there; recordings beside it: recording.mcap"):
        read_recording(tmp_path / "other.mcap")
    with pytest.raises(FileNotFoundError, match="a folder"):
        read_recording(tmp_path)
    picture = tmp_path / "picture.mcap"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n and so on")
    with pytest.raises(NotARecordingError, match="picture.mcap is not an MCAP file"):
        read_recording(picture)


def test_a_foreign_mcap_is_no_recording(tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/camera", "json", 0)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    with pytest.raises(NotARecordingError, match="topics in it: /camera"):
        list(read_recording(path))
