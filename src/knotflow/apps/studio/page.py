"""The page: a 3-D scene with a panel of tabs (viser), shared by every browser that opens it.

It listens on this machine alone unless another host is given. Other web pages are refused by their
Origin, and on other hosts the address has a token.
"""

from __future__ import annotations

import hmac
import secrets
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import Request, Response, ServerConnection

from knotflow.apps.studio.photo_tab import PhotoTab
from knotflow.apps.studio.scene import camera_position, rgb
from knotflow.apps.studio.session import Session
from knotflow.apps.studio.tabs import AppState, DemonstrateTab, PlanTab, RopeTab
from knotflow.viz.style import rope_colour

PANEL_WIDTH = 330  # pixels: leaves at least half of a tablet's screen to the scene
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")


class Page:
    """The studio in the browser; `serve` blocks, `close` ends it."""

    def __init__(self, session: Session, host: str = "localhost", port: int = 8080) -> None:
        """Open the page; on the next free port (`url` names it) where this one is taken."""
        self._token = "" if host in LOCAL_HOSTS else secrets.token_urlsafe(16)
        _check_address(host)
        with _checked_requests(self._token):
            self.server = viser.ViserServer(host, port, label="knotflow studio", verbose=False)
        gui = self.server.gui
        gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=rgb(rope_colour(0.0))
        )
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        self.state = AppState(session, self.server)
        tabs = gui.add_tab_group()
        for label, tab in {
            "Rope": RopeTab, "Photo": PhotoTab, "Plan": PlanTab, "Teach": DemonstrateTab,
        }.items():  # fmt: skip
            with tabs.add_tab(label):
                tab(self.state)
        self.server.on_client_connect(_show_whole_table)
        self.state.rope_changed(
            "Lay a rope, tie a knot into it, or teach an action with three clicks."
        )

    @property
    def url(self) -> str:
        """Address of the page; of this machine where it listens on all of its addresses."""
        host, port = self.server.get_host(), self.server.get_port()
        name = socket.gethostname() if host in ("0.0.0.0", "::") else host
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{port}" + (f"/{self._token}/" if self._token else "")

    def serve(self) -> None:
        """Show the page until interrupted."""
        self.server.sleep_forever()

    def close(self) -> None:
        self.server.stop()


def _check_address(host: str) -> None:
    """Raises OSError where nothing can listen on a host, for which viser waits forever."""
    for family, kind, *_, address in socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM):
        with socket.socket(family, kind) as probe:
            probe.bind(address)


def refusal(headers: Mapping[str, str], path: str, token: str) -> str:
    """Why a request is refused; "" if it is not.

    `token` must be the path's first part; without one, the host must be this machine.
    """
    host = headers.get("Host", "")
    first = path.partition("?")[0].strip("/").partition("/")[0]
    if token and not hmac.compare_digest(first.encode(), token.encode()):
        return "the address lacks the studio's token: open the one that the studio has printed"
    if not token and urlsplit(f"//{host}").hostname not in LOCAL_HOSTS:
        return f"the studio listens on this machine only, not as {host!r}"
    websocket = headers.get("Upgrade", "").lower() == "websocket"
    if websocket and urlsplit(headers.get("Origin", "")).netloc != host:
        return f"a page of {headers.get('Origin', 'unknown origin')} may not use the studio"
    return ""


@contextmanager
def _checked_requests(token: str) -> Iterator[None]:
    """Refuse requests to the viser server that starts in this context.

    viser has no hook for that; it looks up websockets' `serve` when it starts.
    """
    serve = websockets.asyncio.server.serve

    def checked_serve(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def process(connection: ServerConnection, request: Request) -> Response | None:
            if why := refusal(request.headers, request.path, token):
                return connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")
            inner = request.path.removeprefix(f"/{token}") if token else request.path
            answer: Response | None = process_request(connection, replace(request, path=inner))
            return answer

        return serve(*arguments, process_request=process, **options)

    websockets.asyncio.server.serve = checked_serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]


def _show_whole_table(client: viser.ClientHandle) -> None:
    """Move a new browser's camera back until it shows the whole table."""
    camera = client.camera  # describes the whole window: the panel is not laid out yet
    aspect = max(camera.image_width - PANEL_WIDTH, 1) / camera.image_height
    camera.position = camera_position(aspect)
    camera.look_at = (0.0, 0.0, 0.0)  # which has moved along with the position
