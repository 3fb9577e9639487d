"""What tests of recordings share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from knotflow.recording import RecordedRollout


@pytest.fixture
def assert_same() -> Callable[[RecordedRollout, RecordedRollout], None]:
    """Bit for bit, in every field."""

    def check(first: RecordedRollout, second: RecordedRollout) -> None:
        for name in ("times", "points", "gripper", "control_points", "spline"):
            one, other = getattr(first, name), getattr(second, name)
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other, err_msg=name)
        texts = ("action", "start_state", "goal_state", "end_state", "outcome", "signature")
        for name in (*texts, "source", "number", "extra"):
            assert getattr(first, name) == getattr(second, name)

    return check
