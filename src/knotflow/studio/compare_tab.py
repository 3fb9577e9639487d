"""The tab to compare what the primitives propose for an action, and what becomes of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from knotflow.simulation import control_points
from knotflow.studio.playback import Playback
from knotflow.studio.session import Proposals, StudioError
from knotflow.topology import parse_action

if TYPE_CHECKING:
    from knotflow.studio.page import Page


class CompareTab:
    """Simulates proposals side by side."""

    def __init__(self, page: Page) -> None:
        """In the page's current container."""
        self._page, gui = page, page.server.gui
        self._found: Proposals | None = None
        self._action = gui.add_dropdown("Action", ("",))
        self._count = gui.add_slider("Proposals", 1, 12, 1, 4)
        gui.add_button("Propose and simulate").on_click(page.guarded(self._propose))
        self._table = gui.add_markdown("")
        self._shown = gui.add_dropdown("Watch", ("1",), visible=False)
        self._shown.on_update(page.guarded(self._watch))
        page.on_rope(self._forget)

    def _forget(self) -> None:
        self._found, self._table.content, self._shown.visible = None, "", False
        self._action.options = tuple(map(str, self._page.session.actions()))

    def _propose(self, event: viser.GuiEvent) -> None:
        page = self._page
        action = parse_action(self._action.value)
        page.rope_changed(f"Proposing splines for {action}; the primitives are loaded first...")
        self._action.value = str(action)
        self._found = found = page.session.propose(action, int(self._count.value))
        success = found.attempts.success
        rows = "".join(
            f"| {n} | {value:.2f} | {'✅' if ok else '❌'} `{end or 'unreadable'}` |\n"
            for n, (value, ok, end) in enumerate(
                zip(found.values, success, found.attempts.ends, strict=True), 1
            )
        )
        self._table.content = f"| spline | value | ends in |\n|---|---|---|\n{rows}"
        self._shown.options = tuple(str(n) for n in range(1, len(success) + 1))
        self._shown.visible = True
        page.say(f"{success.sum()} of {len(success)} reach {found.attempts.goal}.")
        self._watch(event)

    def _watch(self, event: viser.GuiEvent) -> None:
        if self._found is None:
            raise StudioError("propose splines first")
        page, tried, row = self._page, self._found.attempts, int(self._shown.value) - 1
        radius = page.session.simulation.rope.radius
        page.scene.others(control_points(tried.points, tried.splines, radius))
        page.watch.show(Playback.of_attempt(tried, row, radius))
