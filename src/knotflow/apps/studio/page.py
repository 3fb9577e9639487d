"""The page: a scene with a panel of tabs beside it (viser), shown to every browser that opens it.

The page is one person's table: all browsers see the same rope. It listens on this machine alone
unless another host is given; over ssh, `ssh -L 8080:localhost:8080 MACHINE` brings it home.
"""

from __future__ import annotations

import viser

from knotflow.apps.studio.compare_tab import CompareTab
from knotflow.apps.studio.demonstrate_tab import DemonstrateTab
from knotflow.apps.studio.desk import Desk
from knotflow.apps.studio.plan_tab import PlanTab
from knotflow.apps.studio.rope_tab import RopeTab
from knotflow.apps.studio.scene import eye, rgb
from knotflow.apps.studio.session import Session
from knotflow.viz.style import rope_colour

WIDTH = 330
"""Of the panel, pixels: half of a tablet's screen is left to the scene at least."""


class Page:
    """The studio in the browser; `serve` blocks, `close` ends it.

    Attributes:
        server: of viser.
        desk: what the tabs share.
    """

    def __init__(self, session: Session, host: str = "localhost", port: int = 8080) -> None:
        """Open the page; on the next free port (`url` says which) where this one is taken."""
        self.server = viser.ViserServer(host, port, label="knotflow studio", verbose=False)
        gui, blue = self.server.gui, rgb(rope_colour(0.0))
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=blue)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self.desk = desk = Desk(session, self.server)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Rope"):
            RopeTab(desk)
        with tabs.add_tab("Plan"):
            PlanTab(desk)
        with tabs.add_tab("Compare"):
            CompareTab(desk)
        with tabs.add_tab("Teach"):
            DemonstrateTab(desk)
        self.server.on_client_connect(_step_back)
        desk.rope_changed("Lay a rope, tie a knot into it, or teach an action with three clicks.")

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


def _step_back(client: viser.ClientHandle) -> None:
    """Let a new browser see the whole table, however narrow what the panel leaves of its window."""
    camera = client.camera  # which describes the whole window: the panel is not laid out yet
    camera.position = eye(max(camera.image_width - WIDTH, 1) / camera.image_height)
    camera.look_at = (0.0, 0.0, 0.0)  # which has moved along with the position
