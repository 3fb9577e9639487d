"""The tab to demonstrate an action: three clicks in the scene, simulate, keep."""

from __future__ import annotations

import numpy as np
import viser

from knotflow.apps.studio.app_state import AppState
from knotflow.apps.studio.demonstration import HEIGHTS, Draft
from knotflow.apps.studio.playback import Playback
from knotflow.apps.studio.session import StudioError
from knotflow.topology import parse_action
from knotflow.topology.action_text import describe

_INSTRUCTIONS = {
    "grasp": "Click **1 of 3**: where to grasp the rope.",
    "middle": "Click **2 of 3**: the table below the middle control point.",
    "end": "Click **3 of 3**: where to let go.",
    None: "Set the middle's height, then **simulate**.",
}


class DemonstrateTab:
    """Records demonstrations."""

    def __init__(self, state: AppState) -> None:
        """In the panel's current container."""
        self._state, gui = state, state.server.gui
        self._who = gui.add_text("Your name", "", hint="Kept with each demonstration")
        self._action = gui.add_dropdown("Action", ("",))
        self._description = gui.add_markdown("")
        self._begin = gui.add_button("Demonstrate")
        self._begin.on_click(state.guarded(self._start))
        low, high = HEIGHTS
        self._height = gui.add_slider("Height (m)", low, high, 0.005, 0.15)
        self._height.on_update(state.guarded(self._raise))
        gui.add_button("Undo click", color="gray").on_click(state.guarded(self._undo))
        gui.add_button("Simulate").on_click(state.guarded(self._simulate))
        gui.add_button("Keep").on_click(state.guarded(self._keep))
        self._continue = gui.add_checkbox("Continue from the reached shape", False)
        self._count = gui.add_markdown("")
        self._action.on_update(state.guarded(self._explain))
        state.on_rope(self._forget)

    def _forget(self) -> None:
        self._action.options = tuple(map(str, self._state.session.actions()))
        self._show_count()
        self._explain(None)

    def _explain(self, event: viser.GuiEvent | None) -> None:
        action, state = parse_action(self._action.value), self._state.session.state
        sentence = describe(action, state)
        self._description.content = sentence[sentence.index(":") + 2 :].capitalize()

    def _start(self, event: viser.GuiEvent) -> None:
        state, action = self._state, parse_action(self._action.value)
        state.session.draft = None
        state.rope_changed("")
        self._action.value = str(action)  # type: ignore[misc]  # mypy misses the setter
        draft = state.session.begin(action)
        draft.height = float(self._height.value)
        state.on_click = self._click
        state.scene.rope(draft.points, action)
        state.say(_INSTRUCTIONS[draft.next_click])

    def _draft(self) -> Draft:
        if self._state.session.draft is None:
            raise StudioError("choose an action and press Demonstrate first")
        return self._state.session.draft

    def _click(self, origin: np.ndarray, direction: np.ndarray) -> None:
        self._draft().click(origin, direction)
        self._show()

    def _undo(self, event: viser.GuiEvent) -> None:
        self._draft().undo()
        self._show()

    def _raise(self, event: viser.GuiEvent) -> None:
        if (draft := self._state.session.draft) is not None:
            draft.height = float(self._height.value)
            self._show()

    def _show(self) -> None:
        state, draft = self._state, self._draft()
        state.session.simulated = None  # another spline than the one simulated
        state.player.hide()
        state.scene.gripper(None)
        state.scene.rope(draft.points, draft.action)
        state.scene.spline(draft.controls)
        state.say(_INSTRUCTIONS[draft.next_click])

    def _simulate(self, event: viser.GuiEvent) -> None:
        state, draft = self._state, self._draft()
        state.say("Simulating...")
        simulated = state.session.simulate()
        reached = bool(simulated.success[0])
        end = simulated.ends[0] or "a shape that cannot be read"
        state.player.show(Playback.of_attempt(simulated, 0, draft.rope.radius))
        if reached:
            state.say(f"`{draft.goal}` is **reached**: keep it.", good=True)
        else:
            state.say(f"Not reached: it ends in `{end}`, not in `{draft.goal}`. Redo.", good=False)

    def _keep(self, event: viser.GuiEvent) -> None:
        state, simulated = self._state, self._state.session.simulated
        state.session.keep(self._who.value)
        if self._continue.value and simulated is not None:
            state.session.lay(simulated.rollouts.end_points[0])
        state.rope_changed("")
        state.say(f"Kept in {state.session.file}.", good=True)

    def _show_count(self) -> None:
        session = self._state.session
        self._count.content = f"{len(session.kept())} kept in `{session.file}`"
