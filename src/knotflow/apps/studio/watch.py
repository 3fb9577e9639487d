"""The controls to watch a plan or a spline: play, and a slider to scrub."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import viser

from knotflow.apps.studio.playback import Playback
from knotflow.apps.studio.scene import Scene

_LAST = 1e6  # below whatever the panel holds


class Watch:
    """Plays frames in the scene; hidden while there are none."""

    def __init__(
        self,
        gui: viser.GuiApi,
        scene: Scene,
        guarded: Callable[[Callable[..., None]], Callable[..., None]],
    ) -> None:
        """At the end of the panel; `guarded` wraps what is done on a click."""
        self._gui, self._scene, self._guarded = gui, scene, guarded
        self._playback: Playback | None = None
        self._step: int | None = None  # whose spline is drawn
        self._playing = threading.Lock()
        self._folder = gui.add_folder("Watch", visible=False, order=_LAST)
        with self._folder:
            self._caption = gui.add_markdown("")
            self._play = gui.add_button("Play", color="gray")
            self._play.on_click(guarded(self._run))
        self._slider: viser.GuiSliderHandle[int] | None = None

    def show(self, playback: Playback) -> None:
        """Offer frames to watch, and show the last."""
        self._playback, self._step = playback, None
        if self._slider is not None:
            self._slider.remove()
        last = len(playback) - 1
        with self._folder:
            self._slider = self._gui.add_slider("Frame", 0, last, 1, last)
        self._slider.on_update(self._guarded(self._scrub))
        self._folder.visible = True
        self._draw(last)

    def hide(self) -> None:
        """Nothing to watch."""
        self._playback, self._folder.visible = None, False

    def _scrub(self, event: viser.GuiEvent) -> None:
        if self._slider is not None:
            self._draw(int(self._slider.value))

    def _draw(self, frame: int) -> None:
        shown = self._playback
        if shown is None or frame >= len(shown):
            return
        scene = self._scene
        scene.move(shown.ropes[frame])
        scene.gripper(shown.grippers[frame])
        if (step := int(shown.step[frame])) != self._step:
            scene.spline(shown.controls[step])
            self._step = step
        self._caption.content = shown.caption(frame)

    def _run(self, event: viser.GuiEvent) -> None:
        if not self._playing.acquire(blocking=False):
            return
        try:
            shown, slider = self._playback, self._slider
            for frame in range(0 if shown is None else len(shown)):
                if shown is not self._playback or slider is None:
                    return
                slider.value = frame  # type: ignore[misc]  # mypy misses the setter
                time.sleep(0.08)
        finally:
            self._playing.release()
