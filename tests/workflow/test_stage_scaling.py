"""Every case of workers is timed on the same shards."""

import pandas as pd
import pytest

from knotflow.simulation import SimulationConfig
from knotflow.workflow import StageContext
from knotflow.workflow.stages import scaling
from knotflow.workflow.stages.scaling import ScalingConfig, time_workers

pytestmark = pytest.mark.slow


def test_a_row_a_case_and_ray_only_where_it_is_installed(tmp_path, monkeypatch):
    monkeypatch.setattr(scaling, "SPLINES", 2)
    monkeypatch.setattr(scaling, "find_spec", lambda name: None)
    cases = {"backends": ["loky", "ray"], "rollouts": 4, "run": 0}
    config = ScalingConfig(simulation=SimulationConfig(), **cases)
    time_workers(config, {}, StageContext(tmp_path))
    table = pd.read_csv(tmp_path / "scaling.csv")
    assert list(zip(table["backend"], table["workers"], strict=True)) == [("loky", 1), ("loky", 2)]
    assert (table["shards"] == 2).all()
    assert (table["splines_per_second"] > 0).all()
