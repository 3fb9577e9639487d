from __future__ import annotations

import io
import warnings
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from PIL import Image

from knotflow.recording import (
    DamagedRecordingError,
    NotARecordingError,
    RolloutImages,
    RunLog,
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


def test_round_trip_is_exact(recording, rollouts, assert_same):
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


def test_cut_file_is_refused_at_once(recording):
    whole = recording.read_bytes()
    for cut in [*range(0, len(whole), len(whole) // 60), len(whole) - 1]:
        recording.write_bytes(whole[:cut])
        words = rf"recording.mcap is damaged: it is cut after {cut} bytes"
        for read in (read_recording, read_metadata):
            with pytest.raises(DamagedRecordingError, match=words):
                read(recording)


@pytest.mark.slow
def test_flipped_bytes_never_change_a_trajectory(recording, rollouts, assert_same):
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


def test_file_without_all_frames_is_refused(recording, rollouts):
    with recording.open("rb") as stream:
        messages = list(make_reader(stream).iter_messages(log_time_order=False))
    shorter = recording.with_name("shorter.mcap")
    with shorter.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels: dict[str, int] = {}
        for schema, channel, message in messages[: len(messages) // 2]:
            if channel.topic not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "protobuf", kind)
            writer.add_message(channels[channel.topic], message.log_time, message.data, 0)
        writer.finish()
    with pytest.raises(DamagedRecordingError, match=r"shorter.mcap is damaged: \d+ rollouts lack"):
        list(read_recording(shorter))


def test_errors_are_raised_at_the_call(tmp_path, recording):
    with pytest.raises(FileNotFoundError, match="not there; recordings beside it: recording.mcap"):
        read_recording(tmp_path / "other.mcap")
    with pytest.raises(FileNotFoundError, match="a folder"):
        read_recording(tmp_path)
    picture = tmp_path / "picture.mcap"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n and so on")
    with pytest.raises(NotARecordingError, match="picture.mcap is not an MCAP file"):
        read_recording(picture)


def test_foreign_mcap_is_refused(tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/camera", "json", 0)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    with pytest.raises(
        NotARecordingError, match="foreign.mcap is an MCAP without a single rollout"
    ):
        list(read_recording(path))
    with pytest.raises(NotARecordingError, match="without a single rollout"):
        load(path)


def test_log_of_a_run_says_what_opens_it(tmp_path):
    with RunLog(tmp_path / "run.mcap", {}) as log:
        log.say("looks")
    with pytest.raises(NotARecordingError, match=r"`rerun .*run\.mcap` or Foxglove"):
        list(read_recording(tmp_path / "run.mcap"))


def png(shade):
    file = io.BytesIO()
    Image.new("RGB", (8, 6), (shade, 0, 0)).save(file, "png")
    return file.getvalue()


@pytest.fixture
def camera(make_rollout):
    points = make_rollout(3, frames=5).points
    images = tuple(png(20 * frame) for frame in range(5))
    return RolloutImages(images, points + 0.001, points - 0.002)


def test_round_trip_of_images_and_estimates(tmp_path, make_rollout, camera):
    seen = replace(make_rollout(3, frames=5), camera=camera)
    write_recording(tmp_path / "a.mcap", [make_rollout(1), seen, make_rollout(2)], {})
    read = {one.number: one.camera for one in read_recording(tmp_path / "a.mcap")}
    assert read[1] is None and read[2] is None
    assert read[3].images == camera.images
    assert np.array_equal(read[3].points, camera.points)
    assert np.array_equal(read[3].reference, camera.reference)
    write_recording(
        tmp_path / "b.mcap", [replace(seen, camera=replace(camera, reference=None))], {}
    )
    assert next(read_recording(tmp_path / "b.mcap")).camera.reference is None


def test_images_must_match_frames(make_rollout, camera):
    with pytest.raises(ValueError, match="saw 5 of 6 frames"):
        replace(make_rollout(3, frames=6), camera=camera)
    with pytest.raises(ValueError, match="as many images"):
        RolloutImages(camera.images[:4], camera.points)
