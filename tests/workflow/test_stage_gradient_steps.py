"""A gradient step is timed, on either grid."""

import pandas as pd

from knotflow.workflow import StageContext
from knotflow.workflow.stages.gradient_steps import GradientStepsConfig, time_steps


def test_a_step_takes_milliseconds(tmp_path):
    time_steps(GradientStepsConfig(steps=2, run=0), {}, StageContext(tmp_path))
    steps = pd.read_csv(tmp_path / "gradient_steps.csv")
    assert list(steps["grid"]) == [1, 2]
    assert steps["milliseconds"].between(0.1, 1000).all()
