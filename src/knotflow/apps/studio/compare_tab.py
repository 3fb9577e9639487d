"""The tab to compare what the primitives propose for an action, and what becomes of it."""

from __future__ import annotations

import viser

from knotflow.apps.studio.desk import Desk
from knotflow.apps.studio.playback import Playback
from knotflow.apps.studio.session import SimulatedProposals, StudioError
from knotflow.simulation import control_points
from knotflow.topology import parse_action


class CompareTab:
    """Simulates proposals side by side."""

    def __init__(self, desk: Desk) -> None:
        """In the panel's current container."""
        self._desk, gui = desk, desk.server.gui
        self._found: SimulatedProposals | None = None
        self._action = gui.add_dropdown("Action", ("",))
        self._count = gui.add_slider("Proposals", 1, 12, 1, 4)
        gui.add_button("Propose and simulate").on_click(desk.guarded(self._propose))
        self._table = gui.add_markdown("")
        self._shown = gui.add_dropdown("Watch", ("1",), visible=False)
        self._shown.on_update(desk.guarded(self._watch))
        desk.on_rope(self._forget)

    def _forget(self) -> None:
        self._found, self._table.content, self._shown.visible = None, "", False
        self._action.options = tuple(map(str, self._desk.session.actions()))

    def _propose(self, event: viser.GuiEvent) -> None:
        desk = self._desk
        action = parse_action(self._action.value)
        desk.rope_changed(f"Proposing splines for {action}; the primitives are loaded first...")
        self._action.value = str(action)  # type: ignore[misc]  # mypy misses the setter
        self._found = found = desk.session.propose(action, int(self._count.value))
        success = found.attempts.success
        rows = "".join(
            f"| {n} | {value:.2f} | {'✓' if ok else '✗'} `{end or 'unreadable'}` |\n"
            for n, (value, ok, end) in enumerate(
                zip(found.values, success, found.attempts.ends, strict=True), 1
            )
        )
        self._table.content = f"| spline | value | ends in |\n|---|---|---|\n{rows}"
        self._shown.options = tuple(str(n) for n in range(1, len(success) + 1))
        self._shown.visible = True
        desk.say(f"{success.sum()} of {len(success)} reach {found.attempts.goal}.")
        self._watch(event)

    def _watch(self, event: viser.GuiEvent) -> None:
        if self._found is None:
            raise StudioError("propose splines first")
        desk, tried, row = self._desk, self._found.attempts, int(self._shown.value) - 1
        radius = desk.session.simulation.rope.radius
        desk.scene.others(control_points(tried.points, tried.splines, radius))
        desk.watch.show(Playback.of_attempt(tried, row, radius))
