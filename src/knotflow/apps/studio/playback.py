"""Frames of a plan or of one simulated spline, and the controls that play them in the scene."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotflow.planning import KnotPlan
from knotflow.simulation import Attempts, control_points

if TYPE_CHECKING:
    import viser

    from knotflow.apps.studio.scene import Scene

_LAST = 1e6  # in the order of the panel
_FRAME_SECONDS = 0.08


@dataclass(frozen=True, eq=False)
class Playback:
    """Frames in a row, metres and seconds."""

    times: NDArray[np.float64]  # (T,); a step begins where the one before has ended
    ropes: NDArray[np.float32]  # (T, V, 3)
    grippers: NDArray[np.float32]  # (T, 3)
    step: NDArray[np.intp]  # (T,) index of the step that a frame belongs to
    captions: tuple[str, ...]  # of each step
    controls: NDArray[np.float64]  # (n, 3, 3) of each step's spline

    def __len__(self) -> int:
        return len(self.times)

    def caption(self, frame: int) -> str:
        """Time and step of a frame."""
        return f"{self.times[frame]:.1f} s: {self.captions[self.step[frame]]}"

    @classmethod
    def of_plan(cls, plan: KnotPlan) -> Playback:
        """All steps of a plan with at least one, and with its trajectories."""
        ends = np.cumsum([0.0, *(step.times[-1] for step in plan.steps)])
        return cls(
            times=np.concatenate([s.times + t for s, t in zip(plan.steps, ends, strict=False)]),
            ropes=np.concatenate([step.trajectory for step in plan.steps]),
            grippers=np.concatenate([step.gripper for step in plan.steps]),
            step=np.repeat(np.arange(len(plan.steps)), [len(s.times) for s in plan.steps]),
            captions=tuple(
                f"step {number} of {len(plan.steps)}, {step.action}, to {step.end_state}"
                for number, step in enumerate(plan.steps, 1)
            ),
            controls=plan.controls,
        )

    @classmethod
    def of_attempt(cls, attempts: Attempts, row: int, radius: float) -> Playback:
        """One spline of a batch, on a rope of that radius in metres."""
        motion = attempts.rollouts.motion(row)
        outcome = attempts.ends[row] or "unreadable"
        return cls(
            times=motion.times,
            ropes=motion.trajectory,
            grippers=motion.gripper,
            step=np.zeros(len(motion.times), np.intp),
            captions=(f"{attempts.action}, ends in {outcome}",),
            controls=control_points(attempts.points[row], attempts.splines[row], radius)[None],
        )


class Player:
    """Plays frames in the scene, with a button and a slider; hidden while there are none."""

    def __init__(self, gui: viser.GuiApi, scene: Scene, guarded: Callable[[Any], Any]) -> None:
        """At the end of the panel; `guarded` wraps its handlers."""
        self._gui, self._scene, self._guarded = gui, scene, guarded
        self._playback: Playback | None = None
        self._drawn_step: int | None = None
        self._playing = threading.Lock()
        self._folder = gui.add_folder("Watch", visible=False, order=_LAST)
        with self._folder:
            self._caption = gui.add_markdown("")
            gui.add_button("Play", color="gray").on_click(guarded(self._play))
        self._slider: viser.GuiSliderHandle[int] | None = None

    def show(self, playback: Playback) -> None:
        """Offer frames to play, and show the last."""
        self._playback, self._drawn_step = playback, None
        if self._slider is not None:
            self._slider.remove()
        last = len(playback) - 1
        with self._folder:
            self._slider = slider = self._gui.add_slider("Frame", 0, last, 1, last)
        slider.on_update(self._guarded(lambda event: self._draw(int(slider.value))))
        self._folder.visible = True
        self._draw(last)

    def hide(self) -> None:
        self._playback, self._folder.visible = None, False

    def _draw(self, frame: int) -> None:
        playback = self._playback
        if playback is None or frame >= len(playback):
            return
        self._scene.move(playback.ropes[frame])
        self._scene.gripper(playback.grippers[frame])
        if (step := int(playback.step[frame])) != self._drawn_step:
            self._scene.spline(playback.controls[step])
            self._drawn_step = step
        self._caption.content = playback.caption(frame)

    def _play(self, event: viser.GuiEvent) -> None:
        if not self._playing.acquire(blocking=False):
            return
        try:
            playback, slider = self._playback, self._slider
            for frame in range(0 if playback is None else len(playback)):
                if playback is not self._playback or slider is None:
                    return
                slider.value = frame  # type: ignore[misc]  # mypy misses the setter
                time.sleep(_FRAME_SECONDS)
        finally:
            self._playing.release()
