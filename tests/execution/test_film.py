"""What is shown of an execution is what the camera saw of its drags."""

import numpy as np
import pytest

from knotflow.execution import (
    ImageRecorder,
    TrueState,
    Twin,
    TwinConfig,
    drag_frames,
    draw_execution,
    execute,
)
from knotflow.perception import Camera

CAMERA = Camera.overhead(80, 60)


class Watched(TrueState):
    """The true state, asked for with an image, as one who tracks would."""

    def points(self, robot, grasped):
        robot.observe()
        return super().points(robot, grasped)


@pytest.mark.slow
def test_every_fourth_image_of_a_drag_is_drawn(plan, tmp_path):
    config = TwinConfig(level=0, compute_time=0.0)
    twin = Twin(plan.start, config, np.random.default_rng(1), CAMERA)
    film = ImageRecorder(twin.robot())
    execution = execute(plan, film, source=Watched(twin), estimator=TrueState(twin))
    shown = drag_frames(execution, twin, film.images)
    dragged = np.flatnonzero(np.isfinite(execution.reference[:, 0, 0]))
    assert [one.number for one in shown] == dragged[::4].tolist()
    for one in shown:
        assert abs(one.image.time - twin.times[one.number]) < 1e-6 and one.step == 0
        np.testing.assert_allclose(execution.points[one.number], twin.trajectory[one.number])
    draw_execution(tmp_path / "a.png", execution, CAMERA, shown, film.images[-1])
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
