"""An execution to be looked at: a recording, pictures and an animation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from knotflow.execution import (
    DragFrame,
    Execution,
    ImageRecorder,
    Twin,
    animate_execution,
    drag_frames,
    draw_execution,
    encode_jpeg,
)
from knotflow.perception import Camera
from knotflow.recording import RecordedRollout, RolloutImages, write_recording
from knotflow.workflow.context import StageContext


def show(
    context: StageContext,
    folder: str,
    execution: Execution,
    twin: Twin,
    camera: Camera,
    film: ImageRecorder,
) -> None:
    """A recording, pictures and an animation of one execution; none where nothing was dragged."""
    shown = drag_frames(execution, twin, film.images)
    with context.atomic(folder) as made:
        made.mkdir()
        if not shown:
            return
        facts = {"source": "execution", "signature": context.signature}
        drags = _rollouts(execution, twin, shown, context.signature)
        write_recording(made / "execution.mcap", drags, facts, rope_line=False)
        draw_execution(made / "execution", execution, camera, shown, film.images[-1])
        animate_execution(made / "execution.gif", execution, camera, shown)


def _rollouts(
    execution: Execution, twin: Twin, shown: Sequence[DragFrame], signature: str
) -> Iterator[RecordedRollout]:
    """The drags as rollouts: the true rope, and beside the images what was followed and wanted."""
    for number, outcome in enumerate(execution.outcomes):
        own = [frame for frame in shown if frame.step == number]
        if not own:
            continue
        rows, step = [frame.number for frame in own], outcome.step
        yield RecordedRollout(
            times=execution.times[rows],
            points=np.array(twin.trajectory)[rows].astype(np.float32),
            gripper=execution.gripper[rows].astype(np.float32),
            control_points=step.controls(twin.config.rope.radius),
            spline=step.spline,
            action=str(step.action),
            start_state=str(step.start_state),
            goal_state=str(step.end_state),
            end_state="" if outcome.observed_state is None else str(outcome.observed_state),
            outcome="success" if outcome.observed_state == step.end_state else "failure",
            signature=signature,
            source="execution",
            number=number,
            camera=RolloutImages(
                tuple(encode_jpeg(frame.image) for frame in own),
                execution.points[rows].astype(np.float32),
                execution.reference[rows].astype(np.float32),
            ),
        )
