"""Values that no training can begin with are refused when a workflow is read."""

import re

import pytest

from knotflow.training import JointConfig, KnotsConfig, ReinforcementConfig
from knotflow.training.config import ExplorationConfig


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        (
            ReinforcementConfig,
            {"rounds": [10, 10]},
            "rounds of a reinforcement training are of primitives 1 to 4, got [10, 10]",
        ),
        (
            ReinforcementConfig,
            {"room": [0.0]},
            "room of a reinforcement training are of primitives 1 to 4, got [0.0]",
        ),
        (ExplorationConfig, {"search": 0.8}, "at most 1 together, got 0.8 and 0.3"),
        (ExplorationConfig, {"spread": -0.1}, "got 0.4 and -0.1"),
        (JointConfig, {"goal": "ovrhand"}, "unknown knot 'ovrhand'; valid names: unknot"),
        (JointConfig, {"goal": "unknot"}, "there is nothing to tie in the unknot"),
        (KnotsConfig, {"crossings_shares": [1.0]}, "there is nothing to tie, got 1"),
        (KnotsConfig, {"knots": {"trefoll": 1.0}}, "unknown knot 'trefoll'; valid names: unknot"),
    ],
)
def test_values_out_of_range_are_named(kind, changes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        kind(**changes)
