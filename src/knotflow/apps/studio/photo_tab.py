"""The tab that corrects a photograph's rope: its line and crossings on the picture, on the table.

The rope is drawn as the model of 1 m that a search works on, so that it lies on its picture.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from functools import partial

import numpy as np
import viser
from numpy.typing import NDArray

from knotflow.apps.studio.demonstration import ClickError, table_point
from knotflow.apps.studio.photograph import PhotoError, Photograph
from knotflow.apps.studio.scene import overhead_position
from knotflow.apps.studio.tabs import AppState
from knotflow.planning import RopeInputError

_GAP = 0.8  # widths on either side of a crossing, where the lower strand's line is left out
_DISC, _CROSSING, _LEAST = 0.8, 1.8, 0.012
"""Radii of a handle and of a crossing in widths of the rope, or of a share of its extent."""
_SURE = 0.95  # certainty of a crossing that is drawn as certain
_HINT = (
    "Drag the **white dots** to correct the centre line; click a **crossing** to swap which strand "
    "is on top: the line of the lower one is interrupted."
)
# viser's upload button takes no drops: its input is given the file, as if it was picked.
_DROP = """<div style="margin: 0 0.6em 0.6em; padding: 0.6em; border: 1px dashed #8c959f;
border-radius: 4px; text-align: center; font-size: 0.85em" ondragover="event.preventDefault()"
ondrop="event.preventDefault(); const files = event.dataTransfer.files;
const input = document.querySelector('input[type=file][accept=&quot;image/*&quot;]');
if (files.length) { input.files = files; input.dispatchEvent(new Event('change', {bubbles: true})) }
">or drop it here</div>"""


class PhotoTab:
    """Reads a photograph, shows what is in it and in doubt, and takes corrections."""

    def __init__(self, state: AppState) -> None:
        self._state, gui = state, state.server.gui
        self._lock = threading.Lock()
        self._file: tuple[str, bytes] | None = None
        self._scale, self._middle = 1.0, np.zeros(2)  # metres a pixel, pixels
        self._unit = 0.01  # metres, of discs
        self._grip = np.zeros(2)  # metres from the pointer to the dragged handle
        hint = "A colour image, straight from above"
        upload = gui.add_upload_button("Load a photograph", hint=hint, mime_type="image/*")
        upload.on_upload(state.guarded(self._upload))
        gui.add_html(_DROP)
        self._length = gui.add_text("Length", "", hint="Of the rope, such as 0.9m")
        self._diameter = gui.add_text("Diameter", "", hint="Such as 9mm; empty: as photographed")
        self._colour = gui.add_text("Colour", "", hint="Of the rope, red or #c08070; may be empty")
        for field in (self._length, self._diameter):
            field.on_update(state.guarded(lambda event: self._show_text()))
        self._again = state.button("Read it again", lambda event: self._read(), "gray", False)
        self._text = gui.add_markdown("")
        self._buttons = [
            state.button("It is right", lambda event: self._change(self._photo.confirm)),
            state.button("Swap head and tail", lambda event: self._change(self._photo.reverse)),
            state.button("Undo", lambda event: self._change(self._photo.undo), "gray"),
            state.button("Lay it on the table", self._lay),
        ]
        state.rope_listeners.append(self._rope_changed)

    @property
    def _photo(self) -> Photograph:
        if self._state.session.photo is None:
            raise PhotoError("load a photograph first")
        return self._state.session.photo

    def _upload(self, event: viser.GuiEvent) -> None:
        self._file = event.target.value.name, event.target.value.content
        self._read()

    def _read(self) -> None:
        state = self._state
        if self._file is None:
            raise PhotoError("load a photograph first")
        state.say("Reading the photograph...")
        self._again.visible = True
        photo = state.session.read_photo(*self._file, self._colour.value.strip())
        self._open()
        reach = np.ptp(photo.found.pixels, axis=0) * self._scale / 2 + 0.05
        for client in state.server.get_clients().values():
            client.camera.position = overhead_position(reach, client.camera.aspect)
            client.camera.look_at = (0.0, 0.0, 0.0)
        self._show()
        state.say(_HINT)

    def _open(self) -> None:
        """Show the picture in place of what is on the table."""
        state = self._state
        state.session.open_photo()
        state.on_click = None
        state.player.hide()
        state.scene.clear()
        for listener in state.rope_listeners:
            listener()

    def _lay(self, event: viser.GuiEvent) -> None:
        photo, state = self._photo, self._state
        self._show_text()
        state.say("Fitting a rope of this size...")
        state.session.lay_photo()
        size = photo.size.describe()
        told = state.session.measured.remarks if state.session.measured else ()
        told = (size, *(one for one in told if not one.startswith(size)))  # which assumes options
        state.rope_changed(f"{photo.name}: {'; '.join(told)}.")

    def _rope_changed(self) -> None:
        if self._state.session.photo is not None:
            self._show_picture()
        self._show_text()

    def _change(self, change: Callable[[], None]) -> None:
        with self._lock:
            if self._state.session.laid:
                self._open()
            change()
            self._show()
        self._state.say(_HINT)

    async def _drag(self, event: viser.SceneNodeDragEvent) -> None:
        """Follow a dragged handle; on the event loop, which keeps the order of events."""
        handle, eye = event.instance_index, np.asarray(event.client.camera.position)
        photo = self._state.session.photo
        if photo is None or handle is None or handle >= len(photo.handles):
            return
        try:
            if event.phase == "start":
                held = self._on_table(photo.found.pixels[photo.handles[handle]])
                self._grip = held - table_point(eye, event.start_position - eye)
            at = table_point(eye, np.asarray(event.end_position) - eye) + self._grip
        except ClickError:  # above the horizon
            if event.phase == "end":
                self._show()
            return
        place = at * [1, -1] / self._scale + self._middle
        if event.phase == "end":
            drop = self._state.guarded(self._change)
            await asyncio.to_thread(drop, partial(photo.drag, handle, place))
            return
        line = self._on_table(photo.dragged(handle, place))
        self._state.scene.handles(line[photo.handles], _DISC * self._unit)
        self._show_line(line)

    def _on_table(self, pixels: NDArray) -> NDArray:
        """Points (..., 2) of the photograph on the table, metres."""
        return np.asarray((pixels - self._middle) * self._scale * [1, -1])

    def _show_picture(self) -> None:
        """Lay the picture so that the rope in it has its model's length and place."""
        photo = self._photo
        low, high = photo.found.pixels.min(0), photo.found.pixels.max(0)
        self._scale, self._middle = 1.0 / photo.found.length, (low + high) / 2
        self._unit = self._scale * max(photo.found.width, _LEAST * float(np.max(high - low)))
        size = np.array(photo.rgb.shape[1::-1])
        self._state.scene.picture(photo.rgb, size * self._scale, self._on_table((size - 1) / 2))

    def _show(self) -> None:
        photo, scene = self._photo, self._state.scene
        line = self._on_table(photo.found.pixels)
        self._show_line(line)
        scene.handles(line[photo.handles], _DISC * self._unit, self._drag)
        sure = [one.certainty >= _SURE for one in photo.found.crossings]
        swap = self._state.guarded(
            lambda event: self._change(partial(self._photo.swap, event.instance_index))
        )
        scene.crossings(
            self._on_table(photo.places), _CROSSING * self._unit, sure, swap, line[[0, -1]]
        )
        self._state.headline("In the photograph", photo.state)
        self._show_text()

    def _show_line(self, line: NDArray) -> None:
        """Draw a line (N, 2), metres, interrupted where it is the lower strand."""
        photo = self._photo
        middles = (np.arange(len(line) - 1) + 0.5) / (len(line) - 1)
        gap = _GAP * photo.found.width / photo.found.length
        under = [one.fractions[1 if one.first_over else 0] for one in photo.found.crossings]
        shown = (np.abs(middles[:, None] - np.array([under])) > gap).all(axis=1)
        pieces = np.stack([line[:-1], line[1:]], axis=1)
        self._state.scene.centre_line(pieces[shown], middles[shown])

    def _show_text(self) -> None:
        session = self._state.session
        photo = session.photo
        for button in self._buttons:
            button.visible = photo is not None
        if photo is None:
            self._text.content = ""
            return
        size = self._length.value, self._diameter.value
        if size != (photo.length, photo.diameter):
            if laid := session.laid:
                session.open_photo()  # refused during a search: the size has not changed then
            photo.length, photo.diameter = size
            if laid:
                self._open()
                return
        self._buttons[0].visible = bool(photo.doubts)
        lines = [f"{n}. {one.describe()}" for n, one in enumerate(photo.found.crossings, 1)]
        if photo.doubts:
            lines += ["", "**In doubt:** correct it, or say that it is right", ""]
            lines += [f"- ⚠ {one}" for one in photo.doubts]
        try:
            lines += ["", photo.size.describe()]
        except (PhotoError, RopeInputError) as error:
            lines += ["", f"⚠ {error}"]
        self._text.content = "\n".join(lines)
