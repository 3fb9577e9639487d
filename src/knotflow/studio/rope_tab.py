"""The tab to lay a rope: generated, from a file, drawn with the mouse, or from an image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import viser

from knotflow.studio.draft import place_on_table
from knotflow.studio.session import ROPES

if TYPE_CHECKING:
    from knotflow.studio.page import Page

_IMAGES = {"rgb": "Colour (PNG)", "depth": "Depth (PNG)", "camera": "Camera (YAML)"}


class RopeTab:
    """Lays ropes."""

    def __init__(self, page: Page) -> None:
        """In the page's current container."""
        self._page, gui = page, page.server.gui
        self._corners: list[tuple[float, float]] = []
        self._files: dict[str, bytes] = {}
        self._named = gui.add_dropdown("Rope", ROPES, initial_value="random")
        gui.add_button("Lay it").on_click(page.guarded(self._load))
        gui.add_upload_button(
            "From a file",
            color="gray",
            hint="CSV or NPY, rows of x, y, z, head first",
            mime_type=".csv,.npy",
        ).on_upload(page.guarded(self._upload))
        self._draw = gui.add_button("Draw it with the mouse", color="gray")
        self._draw.on_click(page.guarded(self._begin_or_finish))
        with gui.add_folder("From an image", expand_by_default=False):
            for name, label in _IMAGES.items():
                button = gui.add_upload_button(label, color="gray")
                button.on_upload(page.guarded(lambda event, name=name: self._image(event, name)))

    def _load(self, event: viser.GuiEvent) -> None:
        self._page.session.load(self._named.value)
        self._page.rope_changed(f"A rope: {self._named.value}.")

    def _upload(self, event: viser.GuiEvent) -> None:
        file = event.target.value
        self._page.session.load_upload(file.name, file.content)
        self._page.rope_changed(f"The rope of {file.name}.")

    def _begin_or_finish(self, event: viser.GuiEvent) -> None:
        page = self._page
        drawing = page.takes_click == self._corner
        if drawing:
            page.takes_click = None
            self._draw.label = "Draw it with the mouse"
            corners, self._corners = np.array(self._corners), []
            page.scene.polyline(np.zeros((0, 2)))
            page.session.draw(corners)
            page.rope_changed("The rope as drawn.")
            return
        self._corners = []
        page.scene.polyline(np.zeros((0, 2)))
        page.takes_click = self._corner
        self._draw.label = "Finish drawing"
        page.say("Click along the rope from head to tail; a later strand lies over earlier ones.")

    def _corner(self, origin: np.ndarray, direction: np.ndarray) -> None:
        self._corners.append(place_on_table(origin, direction))
        self._page.scene.polyline(np.array(self._corners))

    def _image(self, event: viser.GuiEvent, name: str) -> None:
        self._files[name] = event.target.value.content
        if missing := [label for key, label in _IMAGES.items() if key not in self._files]:
            self._page.say(f"Still needed: {', '.join(missing)}.")
            return
        self._page.say("Reading the image...")
        doubts = self._page.session.see(self._files)
        self._files = {}
        self._page.rope_changed(
            "The rope of the image." + "".join(f" In doubt: {d}." for d in doubts)
        )
