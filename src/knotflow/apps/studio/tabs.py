"""The tabs: to lay a rope, to plan a knot, and to demonstrate an action; and what they share."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from io import StringIO
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from knotflow.apps.studio.demonstration import HEIGHTS, Draft, rope_from_drawing, table_point
from knotflow.apps.studio.playback import Frame, Player, attempt_frames, plan_frames
from knotflow.apps.studio.scene import Scene
from knotflow.apps.studio.session import ROPES, Session, StudioError
from knotflow.planning import KnotPlan, RopeOptions, SearchStoppedError, SearchUpdate
from knotflow.topology import KNOT_NAMES, TopologicalState, knot, parse_action
from knotflow.topology.action_text import describe
from knotflow.topology.draw import draw
from knotflow.viz.rope import rope_image

_IMAGES = {"rgb": "Colour (PNG)", "depth": "Depth (PNG, NPY)", "camera": "Camera (YAML, JSON)"}
_DRAW = "Draw it with the mouse"
_WIDTH = 0.02  # metres, of a rope of one metre: thick enough to see in a small picture
_INSTRUCTIONS = {
    "grasp": "Click **1 of 3**: where to grasp the rope.",
    "middle": "Click **2 of 3**: the table below the middle control point.",
    "end": "Click **3 of 3**: where to let go.",
    None: "Set the middle's height, then **simulate**.",
}

Handler = Callable[..., None]


class AppState:
    """A session on a page.

    Attributes:
        on_click: takes the next click in the scene, a ray from an origin (3,), metres, along
            a direction (3,); None ignores it.
        rope_listeners: called whenever another rope is laid.
    """

    def __init__(self, session: Session, server: viser.ViserServer) -> None:
        self.session, self.server = session, server
        self.scene = Scene(server, session.simulation.rope)
        self.on_click: Callable[[NDArray, NDArray], None] | None = None
        self._rope_line = server.gui.add_markdown("")
        self._message_line = server.gui.add_markdown("")
        self.rope_listeners: list[Callable[[], None]] = []
        self.player = Player(server.gui, self.scene, self.guarded)
        server.scene.on_click()(self.guarded(self._clicked))

    def button(
        self, label: str, handler: Handler, color: Any = None, visible: bool = True
    ) -> viser.GuiButtonHandle:
        """Add a button with a guarded handler to the panel's current container."""
        button = self.server.gui.add_button(label, color=color, visible=visible)
        button.on_click(self.guarded(handler))
        return button

    def say(self, text: str, good: bool | None = None) -> None:
        """Show a message above the tabs."""
        mark = {True: "✓ ", False: "⚠ ", None: ""}[good]
        self._message_line.content = f"{mark}{text}"

    def guarded(self, handler: Handler) -> Handler:
        """The handler, with its errors shown on the page instead of raised in a thread."""

        @wraps(handler)
        def run(*arguments: Any) -> None:
            try:
                handler(*arguments)
            except (ValueError, OSError, ImportError) as error:
                self.say(str(error), good=False)

        return run

    def rope_changed(self, text: str) -> None:
        """Show the session's rope and a message, and update the tabs."""
        session = self.session
        self.on_click = None
        self.player.hide()
        self.scene.clear()
        self.scene.size = session.rope
        self.scene.rope(session.points)
        self.headline("On the table", session.state)
        for listener in self.rope_listeners:
            listener()
        self.say(text)

    def watch(self, frames: list[Frame]) -> None:
        """Offer frames to play; the state above the tabs is that before them."""
        self.player.show(frames)
        if self.session.photo is None:
            self.headline("Before", self.session.state)

    def unwatch(self) -> None:
        """Offer no frames."""
        self.player.hide()
        if self.session.photo is None:
            self.headline("On the table", self.session.state)

    def headline(self, where: str, state: TopologicalState | None) -> None:
        """Show where a rope is and its state above the tabs."""
        count = "no state can be read"
        if state is not None:
            number = state.num_crossings
            count = "no crossing" if not number else f"{number} crossing{'s' * (number > 1)}"
            count = f"`{state}`, {count}"
        self._rope_line.content = f"**{where}:** {count}"

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        if self.on_click is not None:
            self.on_click(np.array(event.ray_origin), np.array(event.ray_direction))


class RopeTab:
    """Lays ropes: generated, from a file, drawn with the mouse, or from an image."""

    def __init__(self, state: AppState) -> None:
        self._state, gui = state, state.server.gui
        self._corners: list[tuple[float, float]] = []
        self._files: dict[str, tuple[str, bytes]] = {}
        self._name = gui.add_dropdown("Rope", ROPES, initial_value="random")
        state.button("Lay it", self._lay)
        hint = "CSV or NPY, rows of x, y, z, head first; the unit in the header, as in x [mm], or m"
        button = gui.add_upload_button(
            "From a file", color="gray", hint=hint, mime_type=".csv,.npy"
        )
        button.on_upload(state.guarded(self._upload))
        self._length = gui.add_text("Its length", "", hint="Such as 0.9m; empty: the file's, or 1m")
        self._diameter = gui.add_text(
            "Its diameter", "", hint="Such as 9mm; empty: 1/100 of the length"
        )
        self._draw = state.button(_DRAW, self._start_or_finish_drawing, "gray")
        with gui.add_folder("From an image", expand_by_default=False):
            for name, label in _IMAGES.items():
                button = gui.add_upload_button(label, color="gray")
                button.on_upload(state.guarded(lambda event, name=name: self._image(event, name)))
        state.rope_listeners.append(self._end_drawing)

    def _end_drawing(self) -> None:
        self._corners, self._draw.label = [], _DRAW

    def _lay(self, event: viser.GuiEvent) -> None:
        self._state.session.lay_named(self._name.value)
        self._state.rope_changed(f"A rope: {self._name.value}.")

    def _upload(self, event: viser.GuiEvent) -> None:
        file = event.target.value
        self._state.session.lay_upload(file.name, file.content, self._options())
        self._state.rope_changed(f"The rope of {file.name}: {self._remarks()}.")

    def _remarks(self) -> str:
        measured = self._state.session.measured
        return "" if measured is None else "; ".join(measured.remarks)

    def _options(self) -> RopeOptions:
        length, diameter = (one.value.strip() or None for one in (self._length, self._diameter))
        return RopeOptions(length=length, diameter=diameter)

    def _start_or_finish_drawing(self, event: viser.GuiEvent) -> None:
        state, drawing = self._state, self._state.on_click == self._add_corner
        corners = np.array(self._corners)
        self._end_drawing()
        state.scene.polyline(np.zeros((0, 2)))
        if drawing:
            state.on_click = None
            state.session.lay(rope_from_drawing(corners, state.session.simulation.rope))
            state.rope_changed("The rope as drawn.")
        else:
            state.on_click, self._draw.label = self._add_corner, "Finish drawing"
            state.say("Click along the rope from head to tail; later strands lie over earlier.")

    def _add_corner(self, origin: np.ndarray, direction: np.ndarray) -> None:
        self._corners.append(table_point(origin, direction))
        self._state.scene.polyline(np.array(self._corners))

    def _image(self, event: viser.GuiEvent, name: str) -> None:
        self._files[name] = event.target.value.name, event.target.value.content
        if missing := [label for key, label in _IMAGES.items() if key not in self._files]:
            self._state.say(f"Still needed: {', '.join(missing)}.")
            return
        self._state.say("Reading the image...")
        ambiguities = self._state.session.lay_image(self._files, self._options())
        self._files = {}  # kept where one of them cannot be read: it is loaded again alone
        self._state.rope_changed(
            f"The rope of the image: {self._remarks()}."
            + "".join(f" Ambiguous: {one}." for one in ambiguities)
        )


class PlanTab:
    """Plans knots, and shows the plan."""

    def __init__(self, state: AppState) -> None:
        self._state, gui = state, state.server.gui
        self._stop = threading.Event()
        self._knot = gui.add_dropdown("Knot", KNOT_NAMES, initial_value="overhand")
        self._picture = gui.add_image(knot_picture(self._knot.value), format="png")
        self._knot.on_update(state.guarded(self._show_picture))
        self._other = gui.add_text("Other", "", hint="Crossings or actions; empty: the knot above")
        self._seconds = gui.add_number("Seconds", 60.0, min=1.0, max=3600.0, step=1.0)
        self._worlds = gui.add_number(
            "Worlds",
            16,
            min=0,
            max=100,
            hint="The plan shall tie in 3/4 of them and of twice as many others; 0: the first",
        )
        self._begin = state.button("Plan", self._plan)
        self._end = state.button("Stop", lambda event: self._stop.set(), "gray", visible=False)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._found = gui.add_markdown("")
        self._json = state.button("Export plan (JSON)", self._export_json, "gray", False)
        self._csv = state.button("Export waypoints (CSV)", self._export_csv, "gray", False)
        state.rope_listeners.append(self._forget)

    def _show_picture(self, event: viser.GuiEvent) -> None:
        self._picture.image = knot_picture(self._knot.value)

    def _forget(self) -> None:
        self._found.content = ""
        self._json.visible = self._csv.visible = False

    def _plan(self, event: viser.GuiEvent) -> None:
        state, limit = self._state, float(self._seconds.value)
        worlds = int(self._worlds.value)
        goal = self._other.value.strip() or self._knot.value
        state.session.lay_photo()
        state.rope_changed(f"Planning {goal}; the primitives are loaded first...")
        self._stop.clear()
        self._begin.disabled = self._end.visible = self._bar.visible = True

        def report(update: SearchUpdate) -> None:
            share = 100.0 * update.seconds / limit
            self._bar.value = min(100.0, share)  # type: ignore[misc]  # mypy misses the setter
            to_go = f"{update.distance} actions to go"
            if update.survival:
                to_go = f"the best plan ties in {update.survival:.0%} of worlds"
            state.say(
                f"{update.branches} splines tried, {update.kept} shapes kept, {to_go}, "
                f"{update.seconds:.0f} s"
            )
            if self._stop.is_set():
                raise SearchStoppedError

        try:
            plan = state.session.search(goal, report, limit, worlds)
        except SearchStoppedError:
            raise StudioError("the search was stopped") from None
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
        if plan.worlds:
            outcome += f" in {plan.survival()}"
        state.say(
            f"{plan.goal} {outcome}, {plan.branches} splines, {plan.seconds:.1f} s"
            + "".join(f". {one.capitalize()}" for one in state.session.remarks),
            plan.solved,
        )
        if plan.steps:
            state.watch(plan_frames(plan))

    def _export_json(self, event: viser.GuiEvent) -> None:
        if (plan := self._state.session.placed_plan) is not None:
            self._send(event, "plan.json", plan.to_json().encode())

    def _export_csv(self, event: viser.GuiEvent) -> None:
        if (plan := self._state.session.placed_plan) is not None:
            plan.waypoints().to_csv(table := StringIO(), plan.frame)
            self._send(event, "waypoints.csv", table.getvalue().encode())

    def _send(self, event: viser.GuiEvent, name: str, content: bytes) -> None:
        if event.client is not None:
            event.client.send_file_download(name, content, save_immediately=True)
            self._state.say(f"Sent {name}, {len(content) / 1e3:.0f} kB.", good=True)


class DemonstrateTab:
    """Records demonstrations: three clicks in the scene, simulate, keep."""

    def __init__(self, state: AppState) -> None:
        self._state, gui = state, state.server.gui
        self._who = gui.add_text("Your name", "", hint="Kept with each demonstration")
        self._action = gui.add_dropdown("Action", ("",))
        self._description = gui.add_markdown("")
        state.button("Demonstrate", self._start)
        low, high = HEIGHTS
        self._height = gui.add_slider("Height (m)", low, high, 0.005, 0.15)
        self._height.on_update(state.guarded(self._raise))
        state.button("Undo click", self._undo, "gray")
        state.button("Simulate", self._simulate)
        state.button("Keep", self._keep)
        self._continue = gui.add_checkbox("Continue from the reached shape", False)
        self._count = gui.add_markdown("")
        self._action.on_update(state.guarded(self._explain))
        state.rope_listeners.append(self._forget)

    def _forget(self) -> None:
        session = self._state.session
        self._action.options = tuple(map(str, session.actions()))
        self._count.content = f"{len(session.kept())} kept in `{session.file}`"
        self._explain(None)

    def _explain(self, event: viser.GuiEvent | None) -> None:
        action, state = parse_action(self._action.value), self._state.session.state
        sentence = describe(action, state)
        self._description.content = sentence[sentence.index(":") + 2 :].capitalize()

    def _start(self, event: viser.GuiEvent) -> None:
        state, action = self._state, parse_action(self._action.value)
        state.session.lay_photo()
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
        state.unwatch()
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
        state.watch(attempt_frames(simulated, 0, draft.rope.radius))
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


@lru_cache
def knot_picture(name: str) -> NDArray[np.uint8]:
    """The diagram (300, 600, 3) of a knot, one of `KNOT_NAMES`."""
    points = draw(max(knot(name)))
    low, high = points[:, :2].min(axis=0) - _WIDTH, points[:, :2].max(axis=0) + _WIDTH
    return rope_image(points, _WIDTH, (low[0], high[0]), (low[1], high[1]), (600, 300))
