"""What the tabs share: the session, the scene, the player, and the lines above the tabs."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from knotflow.apps.studio.playback import Player
from knotflow.apps.studio.scene import Scene
from knotflow.apps.studio.session import SearchStopped, Session

Handler = Callable[..., None]


class AppState:
    """A session on a page.

    Attributes:
        session: the rope, its plan and demonstration.
        server: of the page.
        scene: where it is drawn.
        player: plays plans and splines.
        on_click: takes the next click in the scene, a ray from an origin (3,), metres, along
            a direction (3,); None ignores it.
    """

    def __init__(self, session: Session, server: viser.ViserServer) -> None:
        self.session, self.server = session, server
        self.scene = Scene(server, session.simulation.rope)
        self.on_click: Callable[[NDArray, NDArray], None] | None = None
        self._rope_line = server.gui.add_markdown("")
        self._message_line = server.gui.add_markdown("")
        self._rope_listeners: list[Callable[[], None]] = []
        self.player = Player(server.gui, self.scene, self.guarded)
        server.scene.on_click()(self.guarded(self._clicked))

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
            except SearchStopped:
                self.say("Stopped.")
            except (ValueError, OSError, ImportError) as error:
                self.say(str(error), good=False)

        return run

    def on_rope(self, listener: Callable[[], None]) -> None:
        """Call `listener` whenever another rope is laid."""
        self._rope_listeners.append(listener)

    def rope_changed(self, text: str) -> None:
        """Show the session's rope and a message, and update the tabs."""
        session = self.session
        self.on_click = None
        self.player.hide()
        self.scene.clear()
        self.scene.rope(session.points)
        crossings = session.state.num_crossings
        count = "no crossing" if not crossings else f"{crossings} crossing{'s' * (crossings > 1)}"
        self._rope_line.content = f"**On the table:** `{session.state}`, {count}"
        for listener in self._rope_listeners:
            listener()
        self.say(text)

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        if self.on_click is not None:
            self.on_click(np.array(event.ray_origin), np.array(event.ray_direction))
