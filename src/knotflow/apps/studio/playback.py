"""Frames of a plan or of one simulated spline, and the controls that play them in the scene."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from knotflow.planning import KnotPlan, PlanStep
from knotflow.simulation import Attempts, Motion, control_points

if TYPE_CHECKING:
    import viser

    from knotflow.apps.studio.scene import Scene

_LAST = 1e6  # in the order of the panel
_FRAME_SECONDS = 0.08


@dataclass(frozen=True, eq=False)
class Frame:
    """What is to be seen at one moment, metres."""

    rope: NDArray  # (V, 3)
    gripper: NDArray  # (3,)
    controls: NDArray  # (3, 3) of the spline
    caption: str


def plan_frames(plan: KnotPlan) -> list[Frame]:
    """The steps of a plan with its trajectories, one after the other."""
    frames: list[Frame] = []
    begin = 0.0
    for number, (step, controls) in enumerate(zip(plan.steps, plan.controls, strict=True), 1):
        what = f"step {number} of {len(plan.steps)}, {step.action}, to {step.end_state}"
        frames += _frames(step, begin, controls, what)
        begin += step.times[-1]
    return frames


def attempt_frames(attempts: Attempts, row: int, radius: float) -> list[Frame]:
    """One spline of a batch, on a rope of that radius in metres."""
    controls = control_points(attempts.points[row], attempts.splines[row], radius)
    what = f"{attempts.action}, ends in {attempts.ends[row] or 'unreadable'}"
    return _frames(attempts.rollouts.motion(row), 0.0, controls, what)


def _frames(motion: Motion | PlanStep, begin: float, controls: NDArray, what: str) -> list[Frame]:
    return [
        Frame(rope, gripper, controls, f"{begin + seconds:.1f} s: {what}")
        for seconds, rope, gripper in zip(
            motion.times, motion.trajectory, motion.gripper, strict=True
        )
    ]


class Player:
    """Plays frames in the scene, with a button and a slider; hidden while there are none."""

    def __init__(self, gui: viser.GuiApi, scene: Scene, guarded: Callable[[Any], Any]) -> None:
        """At the end of the panel; `guarded` wraps its handlers."""
        self._gui, self._scene, self._guarded = gui, scene, guarded
        self._frames: list[Frame] = []
        self._drawn: NDArray | None = None  # the control points in the scene
        self._playing = threading.Lock()
        self._folder = gui.add_folder("Watch", visible=False, order=_LAST)
        with self._folder:
            self._caption = gui.add_markdown("")
            gui.add_button("Play", color="gray").on_click(guarded(self._play))
        self._slider: viser.GuiSliderHandle[int] | None = None

    def show(self, frames: list[Frame]) -> None:
        """Offer frames to play, and show the last."""
        self._frames, self._drawn = frames, None
        if self._slider is not None:
            self._slider.remove()
        last = len(frames) - 1
        with self._folder:
            self._slider = slider = self._gui.add_slider("Frame", 0, last, 1, last)
        slider.on_update(self._guarded(lambda event: self._draw(int(slider.value))))
        self._folder.visible = True
        self._draw(last)

    def hide(self) -> None:
        self._frames, self._folder.visible = [], False

    def _draw(self, number: int) -> None:
        if number >= len(self._frames):
            return
        frame = self._frames[number]
        self._scene.move(frame.rope)
        self._scene.gripper(frame.gripper)
        if frame.controls is not self._drawn:
            self._scene.spline(frame.controls)
            self._drawn = frame.controls
        self._caption.content = frame.caption

    def _play(self, event: viser.GuiEvent) -> None:
        if not self._playing.acquire(blocking=False):
            return
        try:
            frames, slider = self._frames, self._slider
            for number in range(len(frames)):
                if frames is not self._frames or slider is None:
                    return
                slider.value = number  # type: ignore[misc]  # mypy misses the setter
                time.sleep(_FRAME_SECONDS)
        finally:
            self._playing.release()
