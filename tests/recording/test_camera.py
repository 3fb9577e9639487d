"""A recording with what a camera saw is read as it was written, and shown with its images."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from knotflow.recording import RolloutImages, read_recording, write_recording
from knotflow.viz.blueprint import blueprint


def png(shade):
    file = io.BytesIO()
    Image.new("RGB", (8, 6), (shade, 0, 0)).save(file, "png")
    return file.getvalue()


@pytest.fixture
def camera(make_rollout):
    points = make_rollout(3, frames=5).points
    images = tuple(png(20 * frame) for frame in range(5))
    return RolloutImages(images, points + 0.001, points - 0.002)


def test_images_and_estimates_are_read_as_they_were_written(tmp_path, make_rollout, camera):
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


def test_a_sight_has_a_frame_for_each_of_the_rope(make_rollout, camera):
    with pytest.raises(ValueError, match="saw 5 of 6 frames"):
        replace(make_rollout(3, frames=6), camera=camera)
    with pytest.raises(ValueError, match="as many images"):
        RolloutImages(camera.images[:4], camera.points)
    with pytest.raises(ValueError, match="as many ropes as estimates"):
        replace(camera, reference=camera.points[:4])
    with pytest.raises(ValueError, match="image 1 of a rollout is neither"):
        RolloutImages((camera.images[0], b"GIF89a"), camera.points[:2])


def test_only_a_recording_with_images_has_a_view_of_them():
    def views(layout):
        return [type(one).__name__ for one in layout.root_container.contents[0].contents]

    assert "Spatial2DView" in views(blueprint(0.008, camera=True))
    plain = blueprint(0.008).root_container.contents[0]
    assert type(plain).__name__ == "Spatial3DView"
