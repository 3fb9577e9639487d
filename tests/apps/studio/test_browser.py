"""The page in a real browser: Debian's chromium, headless, driven by playwright.

    apt-get install chromium && pip install 'knotflow[test]'

The scripted person presses the page's own buttons and clicks on its 3-D canvas, where the camera
that the browser reports says that a place in the world is to be seen.
"""

import base64
import importlib
import os
import shutil
import time
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.perception.photographs import centre_line, photograph

from knotflow.apps.cli import main
from knotflow.apps.studio.session import Session
from knotflow.samplers.demonstrations import TASKS, load_demonstrations
from knotflow.simulation import check_splines, resample
from knotflow.training import ImitationConfig

viser = pytest.importorskip("viser", reason="the studio needs: pip install 'knotflow[studio]'")
playwright = pytest.importorskip(
    "playwright.sync_api", reason="browser tests need: pip install playwright"
)
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="browser tests need: apt-get install chromium"),
]

FLAGS = (
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu-compositing",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-rasterization",  # Debian enables it: in software it costs seconds a frame
)
PATIENCE = float(os.environ.get("PATIENCE", "60"))
"""Seconds for a whole test, for opening its page, and for each of many demonstrations: what fails
fails soon. On a busy machine, set the environment variable higher."""


FRAMES = """
window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 100);
window.cancelAnimationFrame = clearTimeout;
"""
"""Ten frames a second: viser draws as often as it may, and rendering in software takes a core."""
DROP = """(box, [content, name]) => {
  const bytes = Uint8Array.from(atob(content), (one) => one.charCodeAt(0));
  const dropped = new DataTransfer();
  dropped.items.add(new File([bytes], name));
  box.dispatchEvent(new DragEvent("drop", { dataTransfer: dropped, bubbles: true }));
}"""
"""What a browser does where a file is dropped."""


class Person:
    """Someone at the studio's page."""

    def __init__(self, page, studio):
        self._page, self.studio = page, studio
        self.end = time.monotonic() + PATIENCE

    def arrive(self):
        """Open the page; the test's time counts from here."""
        self.page.goto(self.studio.url)
        self.page.get_by_role("tab", name="Teach").wait_for()
        self.until(self.studio.server.get_clients, "the browser to connect")
        self.rest()

    @property
    def page(self):
        """The page, which waits for as long as the test has left."""
        self._page.set_default_timeout(1000 * max(self.end - time.monotonic(), 0.1))
        return self._page

    def rest(self):
        """Begin something new: the time counts from here."""
        self.end = time.monotonic() + PATIENCE

    def tab(self, name):
        # By force: without waiting for frames, of which software rendering has few.
        tab = self.page.get_by_role("tab", name=name)
        tab.click(force=True)
        while tab.get_attribute("aria-selected") != "true":  # a click while it is drawn is lost
            assert time.monotonic() < self.end, f"the tab {name} does not open"
            time.sleep(0.2)
            tab.click(force=True)

    def press(self, name, done=None):
        """Press a button; once more where `done` does not follow: a click while it is drawn is
        lost."""
        button = self.page.get_by_role("button", name=name, exact=True)
        button.click(force=True)
        pressed = time.monotonic()
        while done is not None and not done():
            assert time.monotonic() < self.end, f"waited in vain for {name}"
            self.page.wait_for_timeout(50)
            if time.monotonic() > pressed + 10:
                button.click(force=True)
                pressed = time.monotonic()

    def type(self, label, text):
        # Not by label: viser's labels of text inputs name an id that no input has.
        beside = self.page.get_by_text(label, exact=True).locator("xpath=following::input[1]")
        beside.fill(text, force=True)
        self.until(lambda: text in {handle.value for handle in self.texts()}, f"{label}: {text}")

    def number(self, label, value):
        beside = self.page.locator(f'label:text-is("{label}")')
        field = beside.locator("xpath=following::input[@inputmode='decimal'][1]")
        field.fill(f"{value:.3f}", force=True)
        field.press("Enter")

    def choose(self, label, option):
        beside = self.page.locator(f'label:text-is("{label}")')
        box = beside.locator("xpath=following::input[@role='combobox'][1]")
        box.wait_for()  # the tab may still be opening
        wanted = self.page.get_by_role("option", name=option, exact=True)
        while box.input_value() != option:  # a redrawn panel loses clicks and closes lists
            assert time.monotonic() < self.end, f"waited in vain for {label}: {option}"
            with suppress(playwright.TimeoutError):
                if not wanted.is_visible():
                    box.click(force=True, timeout=2000)
                wanted.click(force=True, timeout=2000)
            self.wait(lambda: box.input_value() == option, 0.3)

    def texts(self):
        handles = self.studio.server.gui._gui_input_handle_from_uuid.values()
        return [handle for handle in handles if isinstance(handle.value, str)]

    def seen_at(self, place):
        """Where a place (3,) in the world is to be seen on the page, once viser's notice of slow
        rendering, which lies over the canvas, is closed."""
        for notice in self.page.locator(".mantine-Notification-closeButton").all():
            with suppress(playwright.Error):  # it closes by itself
                notice.click(force=True, timeout=2000)
        camera = camera_of(self)
        turn = viser.transforms.SO3(np.asarray(camera.wxyz)).inverse()
        x, y, z = turn.apply(np.asarray(place) - camera.position)
        box = self.page.locator("canvas").first.bounding_box()
        focal = box["height"] / 2 / np.tan(camera.fov / 2)
        return (
            box["x"] + box["width"] / 2 + focal * x / z,
            box["y"] + box["height"] / 2 + focal * y / z,
        )

    def click_at(self, place):
        """Click on the canvas where a place (3,) in the world is to be seen."""
        where = self.seen_at(place)
        self.page.mouse.move(*where)
        self.page.wait_for_timeout(300)  # what is under the pointer is found out in a frame
        self.page.mouse.click(*where)

    def drag(self, start, end):
        """Drag from one place (3,) in the world to another."""
        (x, y), (to_x, to_y) = self.seen_at(start), self.seen_at(end)
        mouse = self.page.mouse
        mouse.move(x, y)
        self.page.wait_for_timeout(300)  # what is under the pointer is found out in a frame
        mouse.down()
        for share in (0.3, 0.6, 1.0):
            mouse.move(x + share * (to_x - x), y + share * (to_y - y))
            self.page.wait_for_timeout(100)
        mouse.up()
        self.page.wait_for_timeout(500)

    def drop(self, file):
        """Drop a picture's file on the tab for photographs."""
        content = base64.b64encode(file.read_bytes()).decode()
        box = self.page.get_by_text("or drop it here")
        box.evaluate(DROP, [content, file.name])

    def wait(self, done, seconds):
        """Wait for the studio to know, for some seconds at most."""
        begun = time.monotonic()
        while not done() and time.monotonic() < begun + seconds:
            assert time.monotonic() < self.end, "waited in vain"
            self.page.wait_for_timeout(50)

    def until(self, done, what):
        """Wait for the studio to know."""
        while not done():
            assert time.monotonic() < self.end, f"waited in vain for: {what}"
            self.page.wait_for_timeout(50)

    def demonstrate(self, spline):
        """Three clicks for the action that is chosen, and simulate."""
        session = self.studio.state.session
        self.press("Demonstrate", lambda: session.draft is not None)
        along = np.linspace(0, 1, len(session.points))
        grasp = [np.interp(spline[0], along, column) for column in session.points.T]
        radius = session.simulation.rope.radius
        for count, place in enumerate([grasp, [*spline[1:3], radius], [*spline[4:], radius]], 1):
            self.click_at(place)
            self.until(lambda count=count: len(session.draft.clicks) == count, f"click {count}")
        self.number("Height (m)", spline[3])
        self.until(lambda: abs(session.draft.height - spline[3]) < 0.003, "the height")
        self.press("Simulate", lambda: session.simulated is not None)

    def lay(self, name):
        """Lay a rope by its name."""
        session = self.studio.state.session
        before = session.points
        self.tab("Rope")
        self.choose("Rope", name)
        self.press("Lay it", lambda: session.points is not before)

    def teach(self, action):
        """Lay a start of an action and demonstrate it where the shipped demonstration of that start
        went; what misses is redone, as people do."""
        session = self.studio.state.session
        count = len(session.kept())
        for _ in range(6):
            self.rest()
            self.lay("straight" if action[0] == "R" else f"start of {action}")
            shown = min(
                (one for one in load_demonstrations() if str(one.task.action) == action),
                key=lambda one: abs(resample(one.points, session.simulation.rope) - session.points)
                .max(),
            )  # fmt: skip
            self.tab("Teach")
            self.choose("Action", action)
            self.demonstrate(shown.spline)
            if session.simulated.success[0]:
                break
        self.page.get_by_text("keep it.").wait_for()
        self.press("Keep", lambda: len(session.kept()) > count)


@pytest.fixture(scope="module")
def browser():
    # What planning imports takes seconds, more of them once rendering competes for the processor.
    importlib.import_module("knotflow.samplers.primitives.library")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def person(browser, tmp_path):
    from knotflow.apps.studio.page import Page

    session = Session("straight", tmp_path / "mine.jsonl")
    with (
        closing(Page(session, port=8391)) as studio,
        browser.new_page(viewport={"width": 800, "height": 600}, device_scale_factor=0.5) as page,
    ):
        # Shaders are compiled in software: with shadows and reflections that takes seconds.
        studio.server.scene.configure_environment_map(None)
        studio.server.scene.configure_default_lights(cast_shadow=False)
        page.add_init_script(FRAMES)
        someone = Person(page, studio)
        someone.arrive()
        yield someone


def test_ropes_are_laid_and_drawn(person):
    session = person.studio.state.session
    before = session.points
    person.press("Lay it", lambda: session.points is not before)
    person.press("Draw it with the mouse", lambda: person.studio.state.on_click is not None)
    for place in ((-0.4, 0.0, 0.0), (0.2, 0.0, 0.0), (0.2, 0.3, 0.0), (0, 0.3, 0), (0, -0.3, 0)):
        person.click_at(place)
        person.page.wait_for_timeout(200)
    person.press("Finish drawing", lambda: session.state.num_crossings == 1)


def test_three_clicks_are_a_demonstration(person):
    session, shown = person.studio.state.session, load_demonstrations()[0]
    person.tab("Teach")
    person.type("Your name", "Ada")
    person.demonstrate(shown.spline)
    assert session.simulated.success[0]
    assert session.draft.spline == pytest.approx(shown.spline, abs=0.005)
    person.press("Keep", session.kept)
    (kept,) = session.kept()
    assert (kept.task, kept.source, kept.who) == (TASKS[0], "human", "Ada")


WHO = {"Ada": ("R1(0,1,1)", "C(0,2,1)"), "Ben": ("R2(0,0,1,1)", "C(2,0,1)", "C(0,2,1)")}
"""Who demonstrates what: an action of each primitive, one of them by both."""


def test_demonstrations_of_two_people_train_primitives(person, imitated, tmp_path):
    session, both = person.studio.state.session, tmp_path / "both.jsonl"
    files = [str(tmp_path / f"{who}.jsonl") for who in WHO]
    for file, (who, actions) in zip(files, WHO.items(), strict=True):
        session.file = Path(file)  # a studio of their own
        person.tab("Teach")
        person.type("Your name", who)
        for action in actions:
            person.teach(action)
    assert main(["merge", *files, "--out", str(both)]) == 0
    kept = load_demonstrations(both)
    assert [(one.source, one.who, str(one.task.action)) for one in kept] == [
        ("human", who, action) for who, actions in WHO.items() for action in actions
    ]

    library = imitated(both, tmp_path, 4, 8, ImitationConfig(steps=5, validations=3))
    trained = {action for some in library.trained_on.values() for action in some}
    assert trained == {one.task.action for one in kept}
    for one in kept:
        points = resample(one.points, session.simulation.rope)
        check_splines(library.sample(points, one.task.action, 2, np.random.default_rng(0)))


def test_plan_is_made_and_exported(person):
    person.tab("Plan")
    person.type("Other", "R1(0,1,1)")
    person.press("Plan", lambda: person.studio.state.session.plan is not None)
    assert person.studio.state.session.plan.solved
    with person.page.expect_download() as download:
        person.press("Export plan (JSON)")
    assert download.value.suggested_filename == "plan.json"


def test_clicks_beside_the_rope_are_explained(person):
    person.tab("Teach")
    person.press("Demonstrate", lambda: person.studio.state.session.draft is not None)
    person.click_at((0.0, 0.3, 0.0))
    person.page.get_by_text("grasp the rope: that was").wait_for()


def test_start_of_a_task_can_be_laid(person):
    session = person.studio.state.session
    session.lay_named("start of C(2,0,1)")
    person.studio.state.rope_changed("Laid.")
    person.page.get_by_text(str(session.state)).first.wait_for()
    assert session.points == pytest.approx(resample(session.points, session.simulation.rope))


def test_a_dropped_photograph_is_corrected_and_laid(person, tmp_path):
    line = centre_line("overhand", (240, 320))
    drawn = photograph(line, [True, False, True], (240, 320), width=7)
    Image.fromarray(drawn).save(tmp_path / "rope.png")
    session = person.studio.state.session
    person.tab("Photo")
    person.drop(tmp_path / "rope.png")
    person.until(lambda: session.photo is not None, "the photograph")
    photo = session.photo
    low, high = photo.found.pixels.min(0), photo.found.pixels.max(0)
    person.until(lambda: abs(camera_of(person).position[1]) < 0.01, "the view from above")

    def on_table(pixel):
        x, y = (pixel - (low + high) / 2) / length * [1, -1]
        return x, y, 0.003

    length, state = photo.found.length, photo.state
    handle = photo.found.pixels[photo.handles[5]]

    def is_dragged():
        return np.linalg.norm(photo.found.pixels - handle - [1, 4], axis=1).min() < 1

    while not is_dragged():  # what is dragged while it is drawn is lost, or its last moves are
        handles = photo.found.pixels[photo.handles]
        nearest = handles[np.linalg.norm(handles - handle, axis=1).argmin()]
        person.drag(on_table(nearest), on_table(handle + [1, 4]))
        person.wait(is_dragged, 2.0)
    person.rest()
    while photo.state == state:  # a click is lost, too
        person.click_at(on_table(photo.places[0]))
        person.wait(lambda: photo.state != state, 5.0)
    person.page.get_by_text(str(photo.state)).first.wait_for()
    person.page.get_by_text("a photograph has no scale").first.wait_for()
    person.type("Length", "0.9m")
    person.press("Lay it on the table", lambda: session.laid)
    assert session.state == photo.state
    assert session.measured.size.length == 0.9


def camera_of(person):
    return next(iter(person.studio.server.get_clients().values())).camera
