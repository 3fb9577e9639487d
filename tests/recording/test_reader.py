from __future__ import annotations

import warnings

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from knotflow.recording import (
    DamagedRecordingError,
    NotARecordingError,
    load,
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


def test_a_cut_file_is_refused_at_once_and_names_its_repair(recording):
    whole = recording.read_bytes()
    for cut in [*range(0, len(whole), len(whole) // 60), len(whole) - 1]:
        recording.write_bytes(whole[:cut])
        words = rf"recording.mcap is damaged: it is cut after {cut} bytes.*mcap recover recording"
        for read in (read_recording, read_metadata):
            with pytest.raises(DamagedRecordingError, match=words):
                read(recording)


def test_flipped_bytes_never_give_a_wrong_trajectory(recording, rollouts, assert_same):
    whole = recording.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for place in rng.integers(8, len(whole) - 8, 60):
        damaged = bytearray(whole)
        damaged[place] ^= int(rng.integers(1, 256))
        recording.write_bytes(damaged)
        found = []
        try:
            found.extend(read_recording(recording))
        except DamagedRecordingError:
            refused += 1
        else:
            assert len(found) == COUNT
        for written, read in zip(rollouts, found, strict=False):
            assert_same(written, read)
    assert refused > 50


def test_a_recovered_recording_gives_its_whole_rollouts_and_counts_the_others(
    recording, rollouts, assert_same
):
    """What `mcap recover` makes of a cut file: a complete file of the messages before the cut."""
    with recording.open("rb") as stream:
        messages = list(make_reader(stream).iter_messages(log_time_order=False))
    recovered = recording.with_name("recovered.mcap")
    with recovered.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels: dict[str, int] = {}
        for schema, channel, message in messages[: len(messages) // 2]:
            if channel.topic not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "protobuf", kind)
            writer.add_message(channels[channel.topic], message.log_time, message.data, 0)
        writer.finish()
    with pytest.warns(UserWarning, match=r"recovered.mcap announces \d+ rollouts without all"):
        found = list(read_recording(recovered))
    assert 10 < len(found) < 32
    for written, read in zip(rollouts, found, strict=False):
        assert_same(written, read)
    with pytest.warns(UserWarning, match="recovered.mcap announces"):
        assert load(recovered)["number"].tolist() == [rollout.number for rollout in found]


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
    with pytest.raises(
        NotARecordingError, match="foreign.mcap is an MCAP without a single whole rollout"
    ):
        list(read_recording(path))
