from __future__ import annotations

import io

import numpy as np
import pytest

from knotflow.recording import scene, topics, write_recording
from knotflow.viz import blueprint
from knotflow.viz.headless import check_recording, why_not_headless

pytestmark = pytest.mark.skipif(bool(why_not_headless()), reason=why_not_headless() or "can run")


@pytest.fixture
def recording(tmp_path, make_rollout):
    path = tmp_path / "recording.mcap"
    write_recording(path, [make_rollout(1), make_rollout(2)], {"stage": "test"})
    return path


def pixels_like(png: bytes, rgb: tuple[int, int, int]) -> int:
    """How many pixels have the hue of a colour, however it is lit."""
    image = pytest.importorskip("PIL.Image").open(io.BytesIO(png)).convert("RGB")
    pixels = np.asarray(image, float).reshape(-1, 3)
    bright = pixels[pixels.max(axis=1) > 60]
    unit = bright / np.linalg.norm(bright, axis=1, keepdims=True)
    return int((unit @ (np.array(rgb) / np.linalg.norm(rgb)) > 0.995).sum())


def test_rerun_shows_rope_gripper_spline_and_topology(recording):
    report = check_recording(recording, at=0.2)
    assert report.problems == ()
    assert {topics.ROPE, topics.ROPE_LINE, topics.GRIPPER, topics.SPLINE, topics.TOPOLOGY} <= set(
        report.entities
    )
    for name in ("HEAD_RGB", "TAIL_RGB", "GRIPPER_RGB", "SPLINE_RGB", "CONTROL_RGB"):
        assert pixels_like(report.scene, getattr(scene, name)) > 30, name
    assert len(report.screenshot) > len(report.scene) > 1000


def test_the_check_sees_what_rerun_cannot_draw(recording, monkeypatch):
    monkeypatch.setattr(blueprint, "_LINES", ".entities[].no_such_field")
    problems = check_recording(recording).problems
    assert len(problems) == 2  # the rope's line and the spline's
    assert all("error: Failed" in problem and len(problem) < 400 for problem in problems)
