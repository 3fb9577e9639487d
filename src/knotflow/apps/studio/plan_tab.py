"""The tab to plan a knot, watch the plan and take it away."""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path

import viser

from knotflow.apps.studio.desk import Desk
from knotflow.apps.studio.pictures import knot_picture
from knotflow.apps.studio.playback import Playback
from knotflow.apps.studio.session import StudioError
from knotflow.planning import KnotPlan, SearchUpdate
from knotflow.topology import KNOT_NAMES


class PlanTab:
    """Plans knots."""

    def __init__(self, desk: Desk) -> None:
        """In the panel's current container."""
        self._desk, gui = desk, desk.server.gui
        self._stop = threading.Event()
        self._knot = gui.add_dropdown("Knot", KNOT_NAMES, initial_value="overhand")
        self._picture = gui.add_image(knot_picture(self._knot.value), format="png")
        self._knot.on_update(desk.guarded(self._chosen))
        self._other = gui.add_text("Other", "", hint="Crossings or actions; empty: the knot above")
        self._seconds = gui.add_number("Seconds", 60.0, min=1.0, max=3600.0, step=1.0)
        self._begin = gui.add_button("Plan")
        self._begin.on_click(desk.guarded(self._plan))
        self._end = gui.add_button("Stop", color="gray", visible=False)
        self._end.on_click(lambda event: self._stop.set())
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._found = gui.add_markdown("")
        self._json = gui.add_button("Export plan (JSON)", color="gray", visible=False)
        self._json.on_click(desk.guarded(self._export_json))
        self._csv = gui.add_button("Export waypoints (CSV)", color="gray", visible=False)
        self._csv.on_click(desk.guarded(self._export_csv))
        desk.on_rope(self._forget)

    def _chosen(self, event: viser.GuiEvent) -> None:
        self._picture.image = knot_picture(self._knot.value)

    def _forget(self) -> None:
        self._found.content = ""
        self._json.visible = self._csv.visible = False

    def _plan(self, event: viser.GuiEvent) -> None:
        desk, limit = self._desk, float(self._seconds.value)
        knot = self._other.value.strip() or self._knot.value
        desk.rope_changed(f"Planning {knot}; the primitives are loaded first...")
        self._stop.clear()
        self._begin.disabled = self._end.visible = self._bar.visible = True

        def report(update: SearchUpdate) -> None:
            share = 100.0 * update.seconds / limit
            self._bar.value = min(100.0, share)  # type: ignore[misc]  # mypy misses the setter
            desk.say(
                f"{update.branches} splines tried, {update.nodes} shapes kept, "
                f"{update.distance} actions to go, {update.seconds:.0f} s"
            )

        try:
            plan = desk.session.search(knot, report, self._stop, limit)
        finally:
            self._begin.disabled = self._end.visible = self._bar.visible = False
        self._show(plan)

    def _show(self, plan: KnotPlan) -> None:
        desk = self._desk
        rows = "".join(
            f"| {number} | {step.action} | `{step.end_state}` |\n"
            for number, step in enumerate(plan.steps, 1)
        )
        self._found.content = f"| step | action | leads to |\n|---|---|---|\n{rows}"
        self._json.visible = self._csv.visible = plan.solved
        outcome = "is tied" if plan.solved else f"is not tied: {plan.reason}"
        desk.say(
            f"{plan.goal} {outcome}, {plan.branches} splines, {plan.seconds:.1f} s", plan.solved
        )
        if (playback := Playback.of_plan(plan)) is not None:
            desk.watch.show(playback)

    def _export_json(self, event: viser.GuiEvent) -> None:
        self._send(event, "plan.json", self._planned().to_json().encode())

    def _export_csv(self, event: viser.GuiEvent) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "waypoints.csv"
            self._planned().waypoints().to_csv(path)
            self._send(event, path.name, path.read_bytes())

    def _planned(self) -> KnotPlan:
        if self._desk.session.plan is None:
            raise StudioError("there is no plan for this rope yet: plan first")
        return self._desk.session.plan

    def _send(self, event: viser.GuiEvent, name: str, content: bytes) -> None:
        if event.client is not None:
            event.client.send_file_download(name, content, save_immediately=True)
            self._desk.say(f"Sent {name}, {len(content) / 1e3:.0f} kB.", good=True)
