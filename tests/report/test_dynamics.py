"""The section of the learned dynamics says why the network errs where it errs by more."""

import pandas as pd
import pytest

from knotflow.report import dynamics
from knotflow.report.results import Results
from knotflow.report.section import Pictures


@pytest.fixture
def told(tmp_path):
    """What is told of errors after 1 and 10 steps, by model and level."""

    def tell(**errors):
        rows = [
            {"model": model, "level": level, "steps": steps, "motions": 4, "mean_error_mm": error}
            for model, levels in errors.items()
            for level, error in enumerate(levels)
            for steps in (1, 10)
        ]
        (tmp_path / "dynamics").mkdir(exist_ok=True)
        pd.DataFrame(rows).to_csv(tmp_path / "dynamics" / "errors.csv", index=False)
        return dynamics.values(Results(tmp_path), Pictures())

    return tell


def test_a_network_that_is_farther_off_is_told_from_one_that_does_not_know_the_rope(told):
    section = told(lstm=[13.0, 15.0], mujoco=[2.0, 12.0])
    assert section["motions"] == 8
    assert section["why"] == {
        "level": "1",
        "lstm_own": "13.0",
        "lstm_last": "15.0",
        "lstm_grown": "2.0",
        "mujoco_own": "2.0",
        "mujoco_last": "12.0",
        "mujoco_grown": "10.0",
    }


def test_nothing_is_to_be_explained_where_the_network_is_closer_or_stands_alone(told):
    assert told(lstm=[3.0, 5.0], mujoco=[2.0, 12.0])["why"] is None
    assert told(lstm=[3.0, 5.0])["why"] is None
    assert told(lstm=[13.0], mujoco=[2.0])["why"] is None
