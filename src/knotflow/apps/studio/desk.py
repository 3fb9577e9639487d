"""What the tabs of the page share: session, scene, what is watched, and the lines that say so."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from knotflow.apps.studio.scene import Scene
from knotflow.apps.studio.session import Session, Stopped
from knotflow.apps.studio.watch import Watch

Handler = Callable[..., None]


class Desk:
    """A session on a page.

    Attributes:
        session: what is done.
        server: of the page.
        scene: where it is drawn.
        watch: plays plans and splines.
        takes_click: who gets the next click in the scene, a ray from an origin (3,), metres, along
            a direction (3,); nobody if None.
    """

    def __init__(self, session: Session, server: viser.ViserServer) -> None:
        """The lines at the top of the panel, and the scene."""
        self.session, self.server = session, server
        self.scene = Scene(server, session.simulation.rope)
        self.takes_click: Callable[[NDArray, NDArray], None] | None = None
        self._lies = server.gui.add_markdown("")
        self._says = server.gui.add_markdown("")
        self._on_rope: list[Callable[[], None]] = []
        self.watch = Watch(server.gui, self.scene, self.guarded)
        server.scene.on_click()(self.guarded(self._clicked))

    def say(self, text: str, good: bool | None = None) -> None:
        """A line above the tabs, on what has happened."""
        mark = {True: "✓ ", False: "⚠ ", None: ""}[good]
        self._says.content = f"{mark}{text}"

    def guarded(self, handler: Handler) -> Handler:
        """The handler, with what it refuses said on the page instead of raised in a thread."""

        @wraps(handler)
        def run(*arguments: Any) -> None:
            try:
                handler(*arguments)
            except Stopped:
                self.say("Stopped.")
            except (ValueError, OSError, ImportError) as error:
                self.say(str(error), good=False)

        return run

    def on_rope(self, listener: Callable[[], None]) -> None:
        """Call a tab whenever another rope lies on the table."""
        self._on_rope.append(listener)

    def rope_changed(self, text: str) -> None:
        """Show the session's rope, update the tabs, and say what happened."""
        session = self.session
        self.takes_click = None
        self.watch.hide()
        self.scene.clear()
        self.scene.rope(session.points)
        crossings = session.state.num_crossings
        count = "no crossing" if not crossings else f"{crossings} crossing{'s' * (crossings > 1)}"
        self._lies.content = f"**On the table:** `{session.state}`, {count}"
        for listener in self._on_rope:
            listener()
        self.say(text)

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        if self.takes_click is not None:
            self.takes_click(np.array(event.ray_origin), np.array(event.ray_direction))
