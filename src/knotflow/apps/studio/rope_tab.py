"""The tab to lay a rope: generated, from a file, drawn with the mouse, or from an image."""

from __future__ import annotations

import numpy as np
import viser

from knotflow.apps.studio.desk import Desk
from knotflow.apps.studio.draft import place_on_table
from knotflow.apps.studio.session import ROPES

_IMAGES = {"rgb": "Colour (PNG)", "depth": "Depth (PNG)", "camera": "Camera (YAML)"}


class RopeTab:
    """Lays ropes."""

    def __init__(self, desk: Desk) -> None:
        """In the panel's current container."""
        self._desk, gui = desk, desk.server.gui
        self._corners: list[tuple[float, float]] = []
        self._files: dict[str, bytes] = {}
        self._named = gui.add_dropdown("Rope", ROPES, initial_value="random")
        gui.add_button("Lay it").on_click(desk.guarded(self._load))
        gui.add_upload_button(
            "From a file",
            color="gray",
            hint="CSV or NPY, rows of x, y, z, head first",
            mime_type=".csv,.npy",
        ).on_upload(desk.guarded(self._upload))
        self._draw = gui.add_button("Draw it with the mouse", color="gray")
        self._draw.on_click(desk.guarded(self._begin_or_finish))
        with gui.add_folder("From an image", expand_by_default=False):
            for name, label in _IMAGES.items():
                button = gui.add_upload_button(label, color="gray")
                button.on_upload(desk.guarded(lambda event, name=name: self._image(event, name)))

    def _load(self, event: viser.GuiEvent) -> None:
        self._desk.session.load(self._named.value)
        self._desk.rope_changed(f"A rope: {self._named.value}.")

    def _upload(self, event: viser.GuiEvent) -> None:
        file = event.target.value
        self._desk.session.load_upload(file.name, file.content)
        self._desk.rope_changed(f"The rope of {file.name}.")

    def _begin_or_finish(self, event: viser.GuiEvent) -> None:
        desk = self._desk
        drawing = desk.takes_click == self._corner
        if drawing:
            desk.takes_click = None
            self._draw.label = "Draw it with the mouse"
            corners, self._corners = np.array(self._corners), []
            desk.scene.polyline(np.zeros((0, 2)))
            desk.session.draw(corners)
            desk.rope_changed("The rope as drawn.")
            return
        self._corners = []
        desk.scene.polyline(np.zeros((0, 2)))
        desk.takes_click = self._corner
        self._draw.label = "Finish drawing"
        desk.say("Click along the rope from head to tail; a later strand lies over earlier ones.")

    def _corner(self, origin: np.ndarray, direction: np.ndarray) -> None:
        self._corners.append(place_on_table(origin, direction))
        self._desk.scene.polyline(np.array(self._corners))

    def _image(self, event: viser.GuiEvent, name: str) -> None:
        self._files[name] = event.target.value.content
        if missing := [label for key, label in _IMAGES.items() if key not in self._files]:
            self._desk.say(f"Still needed: {', '.join(missing)}.")
            return
        self._desk.say("Reading the image...")
        doubts = self._desk.session.see(self._files)
        self._files = {}
        self._desk.rope_changed(
            "The rope of the image." + "".join(f" In doubt: {d}." for d in doubts)
        )
