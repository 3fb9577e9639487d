"""Who may use the page: its own pages in browsers, and with the token where others can reach it."""

import http.client

import pytest

from knotflow.apps.studio.session import Session

viser = pytest.importorskip("viser", reason="the studio needs: pip install 'knotflow[studio]'")

from websockets.exceptions import InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from knotflow.apps.studio.page import Page, refusal  # noqa: E402

OWN = {"Host": "localhost:8080", "Upgrade": "websocket", "Origin": "http://localhost:8080"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"Host": "127.0.0.1:9000", "Origin": "http://127.0.0.1:9000"}, ""),  # through ssh -L
        ({"Origin": "https://evil.example"}, "a page of https://evil.example"),
        ({"Origin": "http://localhost:3000"}, "a page of http://localhost:3000"),
        ({"Origin": "null"}, "a page of null"),
        ({"Origin": ""}, "a page of"),
        # A name of the attacker's that resolves to this machine:
        ({"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}, "this machine only"),
        ({"Host": "evil.example", "Upgrade": ""}, "this machine only"),
        ({"Host": ""}, "this machine only"),
    ],
)
def test_local_page_accepts_its_own_origin_only(changes, words):
    found = refusal(OWN | changes, "/", "")
    assert (words in found) if words else (found == "")


def test_page_for_other_hosts_needs_its_token():
    lab = {"Host": "lab:8080", "Upgrade": "websocket", "Origin": "http://lab:8080"}
    assert refusal(lab, "/secret", "secret") == ""
    assert refusal({"Host": "lab:8080"}, "/secret/?query=1", "secret") == ""
    assert "evil" in refusal(lab | {"Origin": "http://evil.example"}, "/secret", "secret")
    for path in ("/", "", "/other", "/secrets", "/?secret", "/x/secret"):
        assert "token" in refusal(lab, path, "secret")


@pytest.fixture
def open_page(tmp_path):
    pages = []

    def opened(host):
        pages.append(Page(Session("straight", tmp_path / "mine.jsonl"), host, 8471))
        return pages[-1]

    yield opened
    for page in pages:
        page.close()


def test_an_address_of_another_machine_is_refused_at_once(open_page):
    with pytest.raises(OSError, match="assign requested address"):
        open_page("203.0.113.5")


def status(port, path):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    connection.request("GET", path)
    return connection.getresponse().status


def accepts(page, path="", origin=None):
    """Whether a websocket of a page of an origin is opened, and greeted."""
    port = page.server.get_port()
    options = {"origin": origin or f"http://127.0.0.1:{port}", "open_timeout": 5}
    version = [f"viser-v{viser.__version__}"]
    try:
        with connect(f"ws://127.0.0.1:{port}{path}", subprotocols=version, **options) as socket:
            return bool(socket.recv(timeout=5))
    except InvalidStatus as error:
        return error.response.status_code != 403


def test_websocket_of_another_web_page_is_refused(open_page):
    page = open_page("localhost")
    assert status(page.server.get_port(), "/") == 200
    assert accepts(page)
    assert not accepts(page, origin="https://evil.example")


def test_address_for_other_hosts_has_the_token(open_page):
    page = open_page("0.0.0.0")
    port, token = page.server.get_port(), page.url.rstrip("/").rpartition("/")[2]
    assert len(token) > 15
    assert [status(port, path) for path in ("/", f"/{token}/", f"/{token}")] == [403, 200, 200]
    assert accepts(page, f"/{token}")
    assert not accepts(page)
    assert not accepts(page, f"/{token}", origin="https://evil.example")
