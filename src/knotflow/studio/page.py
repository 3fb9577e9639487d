"""The page: a scene with a panel of tabs beside it (viser), shown to every browser that opens it.

The page is one person's table: all browsers see the same rope. It listens on this machine alone
unless another host is given; over ssh, `ssh -L 8080:localhost:8080 MACHINE` brings it home.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np
import viser

from knotflow.drawing.palette import rope_colour
from knotflow.studio.compare_tab import CompareTab
from knotflow.studio.demonstrate_tab import DemonstrateTab
from knotflow.studio.plan_tab import PlanTab
from knotflow.studio.rope_tab import RopeTab
from knotflow.studio.scene import Scene, rgb
from knotflow.studio.session import Session, Stopped
from knotflow.studio.watch import Watch

WIDTH = 330
"""Of the panel, pixels: half of a tablet's screen is left to the scene at least."""

Handler = Callable[..., None]


class Page:
    """The studio in the browser; `serve` blocks, `close` ends it."""

    def __init__(self, session: Session, host: str = "localhost", port: int = 8080) -> None:
        """Open the page; on the next free port (`url` says which) where this one is taken."""
        self.session = session
        self.server = viser.ViserServer(host, port, label="knotflow studio", verbose=False)
        gui = self.server.gui
        gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=rgb(rope_colour(0.0))
        )
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self.scene = Scene(self.server, session.simulation.rope)
        self.takes_click: Callable[[np.ndarray, np.ndarray], None] | None = None
        self._lies = gui.add_markdown("")
        self._says = gui.add_markdown("")
        self._on_rope: list[Callable[[], None]] = []
        tabs = gui.add_tab_group()
        with tabs.add_tab("Rope"):
            self.rope_tab = RopeTab(self)
        with tabs.add_tab("Plan"):
            self.plan_tab = PlanTab(self)
        with tabs.add_tab("Compare"):
            self.compare_tab = CompareTab(self)
        with tabs.add_tab("Teach"):
            self.demonstrate_tab = DemonstrateTab(self)
        self.watch = Watch(self)
        self.server.scene.on_click()(self.guarded(self._clicked))
        self.rope_changed("Lay a rope, tie a knot into it, or teach an action with three clicks.")

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def serve(self) -> None:
        """Show the page until interrupted."""
        self.server.sleep_forever()

    def close(self) -> None:
        """End the server."""
        self.server.stop()

    def say(self, text: str, good: bool | None = None) -> None:
        """A line above the tabs, on what has happened."""
        mark = {True: "✅ ", False: "⚠️ ", None: ""}[good]
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
        """Show the session's rope, tell the tabs, and say what happened."""
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
