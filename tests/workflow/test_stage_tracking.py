"""Ropes are tracked by every method through the same images, and one rollout is kept with them."""

import pandas as pd
import pytest

from knotflow.execution.control.dynamics import SHIPPED_DYNAMICS
from knotflow.perception import EstimateConfig, FitConfig, TrackerConfig
from knotflow.perception.searching import SearchConfig
from knotflow.recording import read_recording
from knotflow.simulation import SimulationConfig
from knotflow.workflow import StageContext
from knotflow.workflow.stages import tracking
from knotflow.workflow.stages.tracking import (
    AT_REST,
    COLUMNS,
    MISPLACED,
    TrackingConfig,
    track_rollouts,
)

pytestmark = pytest.mark.slow


def test_tracks_have_a_row_a_method_and_image(tmp_path, monkeypatch):
    monkeypatch.setattr(tracking, "TASKS", tracking.TASKS[:1])
    quick = EstimateConfig(FitConfig(steps=10), search=SearchConfig(first=1, rounds=0), wider=None)
    config = TrackingConfig(
        simulation=SimulationConfig(record_rate=2.5, threads=1),
        tracker=TrackerConfig(estimate=quick),
        digest="shipped",
        levels=[1],
        rollouts=1,
        weights=str(SHIPPED_DYNAMICS),
        weights_contents="shipped",
        network_contents="shipped",
        seed=0,
    )
    track_rollouts(config, {}, StageContext(tmp_path, "0123456789abcdef"))
    tracks = pd.read_csv(tmp_path / tracking.TABLE)
    assert list(tracks.columns) == COLUMNS
    (recorded,) = read_recording(tmp_path / tracking.RECORDING)
    frames = len(recorded.times)
    assert dict(tracks["method"].value_counts()) == {
        "rendering": frames,
        "rendering_lstm": frames,
        "rendering_mujoco": frames,
        "point_drift": frames,
        "point_drift_predicted": frames,
        AT_REST: 1,
        MISPLACED: 1,
    }
    # By at most 2 mm and 0.2 degrees about each axis, from 1.2 m.
    assert 0 < float(tracks.loc[tracks["method"] == MISPLACED, "mean_error_mm"].item()) < 12
    assert tracks["visible_share"].between(0, 1).all() and tracks["visible_share"].max() > 0.5
    first = tracks[tracks["frame"] == 0]
    assert (first["mean_error_mm"] < 15).all()
    assert len(recorded.camera.images) == frames
    assert recorded.source == "tracking"
    assert [path.name for path in tmp_path.glob("*.csv")] == [tracking.TABLE]
