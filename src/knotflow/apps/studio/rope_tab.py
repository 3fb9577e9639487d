"""The tab to lay a rope: generated, from a file, drawn with the mouse, or from an image."""

from __future__ import annotations

import numpy as np
import viser

from knotflow.apps.studio.app_state import AppState
from knotflow.apps.studio.demonstration import table_point
from knotflow.apps.studio.session import ROPES

_IMAGES = {"rgb": "Colour (PNG)", "depth": "Depth (PNG)", "camera": "Camera (YAML)"}
_DRAW = "Draw it with the mouse"


class RopeTab:
    """Lays ropes."""

    def __init__(self, state: AppState) -> None:
        """In the panel's current container."""
        self._state, gui = state, state.server.gui
        self._corners: list[tuple[float, float]] = []
        self._files: dict[str, bytes] = {}
        self._name = gui.add_dropdown("Rope", ROPES, initial_value="random")
        gui.add_button("Lay it").on_click(state.guarded(self._lay))
        gui.add_upload_button(
            "From a file",
            color="gray",
            hint="CSV or NPY, rows of x, y, z, head first",
            mime_type=".csv,.npy",
        ).on_upload(state.guarded(self._upload))
        self._draw = gui.add_button(_DRAW, color="gray")
        self._draw.on_click(state.guarded(self._start_or_finish_drawing))
        with gui.add_folder("From an image", expand_by_default=False):
            for name, label in _IMAGES.items():
                button = gui.add_upload_button(label, color="gray")
                button.on_upload(state.guarded(lambda event, name=name: self._image(event, name)))

    def _lay(self, event: viser.GuiEvent) -> None:
        self._state.session.lay_named(self._name.value)
        self._state.rope_changed(f"A rope: {self._name.value}.")

    def _upload(self, event: viser.GuiEvent) -> None:
        file = event.target.value
        self._state.session.lay_upload(file.name, file.content)
        self._state.rope_changed(f"The rope of {file.name}.")

    def _start_or_finish_drawing(self, event: viser.GuiEvent) -> None:
        state, drawing = self._state, self._state.on_click == self._add_corner
        corners, self._corners = np.array(self._corners), []
        state.scene.polyline(np.zeros((0, 2)))
        self._draw.label = _DRAW if drawing else "Finish drawing"
        if drawing:
            state.on_click = None
            state.session.lay_drawing(corners)
            state.rope_changed("The rope as drawn.")
        else:
            state.on_click = self._add_corner
            state.say("Click along the rope from head to tail; later strands lie over earlier.")

    def _add_corner(self, origin: np.ndarray, direction: np.ndarray) -> None:
        self._corners.append(table_point(origin, direction))
        self._state.scene.polyline(np.array(self._corners))

    def _image(self, event: viser.GuiEvent, name: str) -> None:
        self._files[name] = event.target.value.content
        if missing := [label for key, label in _IMAGES.items() if key not in self._files]:
            self._state.say(f"Still needed: {', '.join(missing)}.")
            return
        self._state.say("Reading the image...")
        ambiguities = self._state.session.lay_image(self._files)
        self._files = {}
        self._state.rope_changed(
            "The rope of the image." + "".join(f" Ambiguous: {one}." for one in ambiguities)
        )
