"""The tab to demonstrate an action: three clicks in the scene, simulate, keep."""

from __future__ import annotations

import numpy as np
import viser

from knotflow.apps.studio.desk import Desk
from knotflow.apps.studio.draft import HEIGHTS, Draft
from knotflow.apps.studio.playback import Playback
from knotflow.apps.studio.session import StudioError
from knotflow.topology import parse_action
from knotflow.topology.action_text import describe

_ASKS = {
    "grasp": "Click **1 of 3**: where to grasp the rope.",
    "middle": "Click **2 of 3**: the table below the middle control point.",
    "end": "Click **3 of 3**: where to let go.",
    None: "Set the middle's height, then **simulate**.",
}


class DemonstrateTab:
    """Records demonstrations."""

    def __init__(self, desk: Desk) -> None:
        """In the panel's current container."""
        self._desk, gui = desk, desk.server.gui
        self._who = gui.add_text("Your name", "", hint="Kept with each demonstration")
        self._action = gui.add_dropdown("Action", ("",))
        self._words = gui.add_markdown("")
        self._begin = gui.add_button("Demonstrate")
        self._begin.on_click(desk.guarded(self._start))
        low, high = HEIGHTS
        self._height = gui.add_slider("Height (m)", low, high, 0.005, 0.15)
        self._height.on_update(desk.guarded(self._raise))
        gui.add_button("Undo click", color="gray").on_click(desk.guarded(self._undo))
        gui.add_button("Simulate").on_click(desk.guarded(self._simulate))
        gui.add_button("Keep").on_click(desk.guarded(self._keep))
        self._onward = gui.add_checkbox("Go on from the reached shape", False)
        self._count = gui.add_markdown("")
        self._action.on_update(desk.guarded(self._explain))
        desk.on_rope(self._forget)

    def _forget(self) -> None:
        self._action.options = tuple(map(str, self._desk.session.actions()))
        self._tell_count()
        self._explain(None)

    def _explain(self, event: viser.GuiEvent | None) -> None:
        action, state = parse_action(self._action.value), self._desk.session.state
        words = describe(action, state)
        self._words.content = words[words.index(":") + 2 :].capitalize()

    def _start(self, event: viser.GuiEvent) -> None:
        desk, action = self._desk, parse_action(self._action.value)
        desk.session.draft = None
        desk.rope_changed("")
        self._action.value = str(action)  # type: ignore[misc]  # mypy misses the setter
        draft = desk.session.begin(action)
        draft.height = float(self._height.value)
        desk.takes_click = self._click
        desk.scene.rope(draft.points, action)
        desk.say(_ASKS[draft.awaits])

    def _draft(self) -> Draft:
        if self._desk.session.draft is None:
            raise StudioError("choose an action and press Demonstrate first")
        return self._desk.session.draft

    def _click(self, origin: np.ndarray, direction: np.ndarray) -> None:
        self._draft().click(origin, direction)
        self._show()

    def _undo(self, event: viser.GuiEvent) -> None:
        self._draft().undo()
        self._show()

    def _raise(self, event: viser.GuiEvent) -> None:
        if (draft := self._desk.session.draft) is not None:
            draft.height = float(self._height.value)
            self._show()

    def _show(self) -> None:
        desk, draft = self._desk, self._draft()
        desk.session.tried = None  # another spline than the one simulated
        desk.watch.hide()
        desk.scene.gripper(None)
        desk.scene.rope(draft.points, draft.action)
        desk.scene.spline(draft.controls)
        desk.say(_ASKS[draft.awaits])

    def _simulate(self, event: viser.GuiEvent) -> None:
        desk, draft = self._desk, self._draft()
        desk.say("Simulating...")
        tried = desk.session.simulate()
        reached = bool(tried.success[0])
        end = tried.ends[0] or "a shape that cannot be read"
        desk.watch.show(Playback.of_attempt(tried, 0, draft.rope.radius))
        if reached:
            desk.say(f"`{draft.goal}` is **reached**: keep it.", good=True)
        else:
            desk.say(f"Not reached: it ends in `{end}`, not in `{draft.goal}`. Redo.", good=False)

    def _keep(self, event: viser.GuiEvent) -> None:
        desk, tried = self._desk, self._desk.session.tried
        desk.session.keep(self._who.value)
        if self._onward.value and tried is not None:
            desk.session.lay(tried.rollouts.end_points[0])
        desk.rope_changed("")
        desk.say(f"Kept in {desk.session.file}.", good=True)

    def _tell_count(self) -> None:
        session = self._desk.session
        self._count.content = f"{len(session.kept())} kept in `{session.file}`"
