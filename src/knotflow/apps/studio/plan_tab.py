"""The tab to plan a knot and watch the plan."""

from __future__ import annotations

import tempfile
import threading
from functools import lru_cache
from pathlib import Path

import numpy as np
import viser
from numpy.typing import NDArray

from knotflow.apps.studio.app_state import AppState
from knotflow.apps.studio.playback import Playback
from knotflow.planning import KnotPlan, SearchUpdate
from knotflow.topology import KNOT_NAMES, knot
from knotflow.topology.draw import draw
from knotflow.viz.rope import rope_image

_WIDTH = 0.02  # metres, of a rope of one metre: thick enough to see in a small picture


class PlanTab:
    """Plans knots."""

    def __init__(self, state: AppState) -> None:
        """In the panel's current container."""
        self._state, gui = state, state.server.gui
        self._stop = threading.Event()
        self._knot = gui.add_dropdown("Knot", KNOT_NAMES, initial_value="overhand")
        self._picture = gui.add_image(knot_picture(self._knot.value), format="png")
        self._knot.on_update(state.guarded(self._show_picture))
        self._other = gui.add_text("Other", "", hint="Crossings or actions; empty: the knot above")
        self._seconds = gui.add_number("Seconds", 60.0, min=1.0, max=3600.0, step=1.0)
        self._begin = gui.add_button("Plan")
        self._begin.on_click(state.guarded(self._plan))
        self._end = gui.add_button("Stop", color="gray", visible=False)
        self._end.on_click(lambda event: self._stop.set())
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._found = gui.add_markdown("")
        self._json = gui.add_button("Export plan (JSON)", color="gray", visible=False)
        self._json.on_click(state.guarded(self._export_json))
        self._csv = gui.add_button("Export waypoints (CSV)", color="gray", visible=False)
        self._csv.on_click(state.guarded(self._export_csv))
        state.on_rope(self._forget)

    def _show_picture(self, event: viser.GuiEvent) -> None:
        self._picture.image = knot_picture(self._knot.value)

    def _forget(self) -> None:
        self._found.content = ""
        self._json.visible = self._csv.visible = False

    def _plan(self, event: viser.GuiEvent) -> None:
        state, limit = self._state, float(self._seconds.value)
        goal = self._other.value.strip() or self._knot.value
        state.rope_changed(f"Planning {goal}; the primitives are loaded first...")
        self._stop.clear()
        self._begin.disabled = self._end.visible = self._bar.visible = True

        def report(update: SearchUpdate) -> None:
            share = 100.0 * update.seconds / limit
            self._bar.value = min(100.0, share)  # type: ignore[misc]  # mypy misses the setter
            state.say(
                f"{update.branches} splines tried, {update.nodes} shapes kept, "
                f"{update.distance} actions to go, {update.seconds:.0f} s"
            )

        try:
            plan = state.session.search(goal, report, self._stop, limit)
        finally:
            self._begin.disabled = self._end.visible = self._bar.visible = False
        self._show(plan)

    def _show(self, plan: KnotPlan) -> None:
        state = self._state
        rows = "".join(
            f"| {number} | {step.action} | `{step.end_state}` |\n"
            for number, step in enumerate(plan.steps, 1)
        )
        self._found.content = f"| step | action | leads to |\n|---|---|---|\n{rows}"
        self._json.visible = self._csv.visible = plan.solved
        outcome = "is tied" if plan.solved else f"is not tied: {plan.reason}"
        state.say(
            f"{plan.goal} {outcome}, {plan.branches} splines, {plan.seconds:.1f} s", plan.solved
        )
        if plan.steps:
            state.player.show(Playback.of_plan(plan))

    def _export_json(self, event: viser.GuiEvent) -> None:
        if (plan := self._state.session.plan) is not None:
            self._send(event, "plan.json", plan.to_json().encode())

    def _export_csv(self, event: viser.GuiEvent) -> None:
        if (plan := self._state.session.plan) is not None:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "waypoints.csv"
                plan.waypoints().to_csv(path)
                self._send(event, path.name, path.read_bytes())

    def _send(self, event: viser.GuiEvent, name: str, content: bytes) -> None:
        if event.client is not None:
            event.client.send_file_download(name, content, save_immediately=True)
            self._state.say(f"Sent {name}, {len(content) / 1e3:.0f} kB.", good=True)


@lru_cache
def knot_picture(name: str) -> NDArray[np.uint8]:
    """The diagram (300, 600, 3) of a knot, one of `KNOT_NAMES`."""
    points = draw(max(knot(name)))
    low, high = points[:, :2].min(axis=0) - _WIDTH, points[:, :2].max(axis=0) + _WIDTH
    return rope_image(points, _WIDTH, (low[0], high[0]), (low[1], high[1]), (600, 300))
