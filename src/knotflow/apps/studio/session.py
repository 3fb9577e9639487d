"""A studio session without a browser: a rope, plans for it, and demonstrations on it.

A method that simulates blocks the thread that calls it; only one runs at a time.
"""

from __future__ import annotations

import re
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotflow.apps.studio.demonstration import Draft
from knotflow.planning import (
    FAST_SEARCH,
    ROPE_NAMES,
    Hand,
    KnotPlan,
    MeasuredRope,
    RopeOptions,
    RopeTable,
    SearchUpdate,
    SurvivalConfig,
    measured_rope,
    parse_goal,
    parse_rope,
    plan_rope,
)
from knotflow.planning.rope.size import RopeSize
from knotflow.samplers.demonstrations import (
    TASKS,
    Demonstration,
    add_demonstration,
    load_demonstrations,
    task,
    task_at,
)
from knotflow.simulation import (
    Attempts,
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    attempt,
    resample,
)
from knotflow.threads import one_thread
from knotflow.topology import Action, TopologicalState
from knotflow.viz.plan_folder import subsample

if TYPE_CHECKING:
    from knotflow.apps.studio.photograph import Photograph
    from knotflow.samplers.primitives import PrimitiveLibrary

STARTS = {f"start of {one.action}": str(one.action) for one in TASKS if one.start_actions}
ROPES = (*ROPE_NAMES, *STARTS)
"""Ropes to choose from: generated, or a start shape of a shipped demonstration."""

ANY_SIZE = RopeOptions()
"""Of a rope file of which only the file says how long it is."""
MOST_SECONDS = 60.0
"""For which a rope is looked for in an image."""


class StudioError(ValueError):
    """Something that cannot be done now; names what has to come first."""


class Session:
    """A rope on the table, its plan and its demonstration.

    Attributes:
        file: of the kept demonstrations (JSON lines).
        points: (V, 3) the rope at rest, metres; a rope of another size as its model of 1 m.
        measured: the rope's size and where it lies; None of a model rope.
        photo: the photograph that shows the rope, if any.
        laid: whether the rope is on the table as it is in the photograph.
        plan: the last one for this rope, if any.
        remarks: what is to be said of its search.
        draft: the demonstration in the making, if any.
        simulated: the draft's simulation, if any.
    """

    def __init__(self, rope: str = "straight", file: Path = Path("demonstrations.jsonl")) -> None:
        """Lay a rope: one of `ROPES`, or a file; see `planning.measured_rope` for its errors."""
        self.file = file
        self.simulation = SimulationConfig()
        self._rng = np.random.default_rng(0)
        self._busy = threading.Lock()
        if rope in ROPES:
            self.lay_named(rope)
        else:
            self._lay(rope, ANY_SIZE)

    @cached_property
    def simulator(self) -> RopeSimulator:
        return RopeSimulator(self.simulation)

    @cached_property
    def library(self) -> PrimitiveLibrary:
        """The shipped primitives."""
        from knotflow.samplers.primitives import SHIPPED_PRIMITIVES, PrimitiveLibrary  # slow

        return PrimitiveLibrary.load(SHIPPED_PRIMITIVES, self.simulation.rope)

    @property
    def rope(self) -> RopeConfig:
        """Of `points`."""
        return self.measured.model if self.measured else self.simulation.rope

    def lay(self, points: NDArray, measured: MeasuredRope | None = None) -> None:
        """Lay a rope (V, 3), metres; the previous plan, draft and photograph are dropped.

        Raises:
            DegenerateCurveError: its state cannot be read.
            StudioError: a search or simulation is running.
        """
        with self._while_idle():
            self.state = TopologicalState.from_curve(points)
            self.measured = measured
            self.photo: Photograph | None = None
            self.laid = True
            self.points: NDArray[np.float64] = np.array(points, np.float64)
            self._drop()

    def _drop(self) -> None:
        """Forget the plan and the demonstration of the rope before."""
        self.plan: KnotPlan | None = None
        self.remarks: tuple[str, ...] = ()
        self.draft: Draft | None = None
        self.simulated: Attempts | None = None

    def lay_named(self, name: str) -> None:
        """Lay one of `ROPES`."""
        if name not in ROPES:
            raise StudioError(f"there is no rope {name!r}; choose one of {', '.join(ROPES)}")
        rope = self.simulation.rope
        if name in STARTS:
            wanted = task(STARTS[name])
            shapes = [one.points for one in load_demonstrations() if one.task == wanted]
            self.lay(resample(shapes[self._rng.integers(len(shapes))], rope))
        else:
            self.lay(parse_rope(name, rope, self._rng))

    def lay_upload(self, name: str, content: bytes, options: RopeOptions = ANY_SIZE) -> None:
        """Lay the rope of a file that came through the browser."""
        with _uploaded((name, content)) as (path,):
            self._lay(str(path), options)

    def lay_image(
        self, files: Mapping[str, tuple[str, bytes]], options: RopeOptions = ANY_SIZE
    ) -> tuple[str, ...]:
        """Lay the rope of an image, and return what is ambiguous in it.

        `files` are names and contents of `rgb`, `depth` and `camera`, see `perception.io.see`.

        Raises:
            ImageError, CameraError: see `perception.io.see`.
        """
        from knotflow.perception import io

        rope = RopeSize.of_options(options).rope()
        own = (files[key] for key in ("rgb", "depth", "camera"))
        with self._busy, one_thread(), _uploaded(*own) as (rgb, depth, camera):
            found, _ = io.see(rgb, depth, camera, rope, max_seconds=MOST_SECONDS)
        self._lay(RopeTable(found.points, "m", name="the image"), options)
        return found.all_ambiguities

    def _lay(self, rope: str | RopeTable, options: RopeOptions) -> None:
        measured = measured_rope(rope, options, self._rng)
        self.lay(measured.points, measured)

    def read_photo(self, name: str, content: bytes, colour: str = "") -> Photograph:
        """Estimate the rope in a photograph, to be corrected and laid; see `Photograph`."""
        from knotflow.apps.studio.photograph import Photograph  # slow to import
        from knotflow.perception.camera.image import read_colour

        with self._while_idle(), one_thread(), _uploaded((name, content)) as (path,):
            self.photo = Photograph(name, read_colour(path, upright=True), colour)
            self.laid = False
            self._drop()
            return self.photo

    def open_photo(self) -> None:
        """Correct the photograph's rope after it was laid; plan and draft are dropped."""
        with self._while_idle():
            self.laid = False
            self._drop()

    def lay_photo(self) -> None:
        """Lay the photograph's rope, unless it lies there; see `Photograph.rope` for its errors."""
        if self.photo is not None and not self.laid:
            photo, measured = self.photo, self.photo.rope()
            self.lay(measured.points, measured)
            self.photo = photo

    def search(
        self,
        knot: str,
        progress: Callable[[SearchUpdate], None],
        max_seconds: float = 60.0,
        worlds: int = SurvivalConfig.worlds,
    ) -> KnotPlan:
        """Plan a knot for the rope, see `planning.plan_rope`; what `progress` raises ends it."""
        from knotflow.samplers.primitives import UnlikeRopeWarning  # slow

        self.lay_photo()
        with self._busy:
            config = replace(FAST_SEARCH, max_seconds=max_seconds)
            simulation = replace(self.simulation, rope=self.rope)
            hand = self.measured.hand if self.measured else Hand(self.rope.radius)
            with warnings.catch_warnings(record=True) as unlike:
                warnings.simplefilter("ignore")
                warnings.simplefilter("always", UnlikeRopeWarning)
                plan = plan_rope(
                    self.points, knot, self._rng,
                    sampler=self.library, simulation=simulation, config=config, progress=progress,
                    survival=SurvivalConfig(worlds), reach=hand, early=True,
                )  # fmt: skip
        doubts = self.measured.size.doubts(parse_goal(knot, self.rope)) if self.measured else ""
        self.remarks = (*filter(None, [doubts]), *(str(one.message) for one in unlike))
        self.plan = subsample(plan)
        return self.plan

    @property
    def placed_plan(self) -> KnotPlan | None:
        """The plan, for a measured rope in its real size where it lies."""
        if self.plan is None or self.measured is None:
            return self.plan
        return self.plan.placed(self.measured.placement, self.measured.frame)

    def actions(self) -> list[Action]:
        """The actions that the rope's state allows; first the tasks that start in it."""
        common = [one.action for one in TASKS if one.start_state == self.state]
        legal = dict.fromkeys(action for action, _ in self.state.actions())
        return sorted(legal, key=lambda action: (action not in common, str(action)))

    def begin(self, action: Action) -> Draft:
        """Begin a demonstration of a legal action, in place of the one before."""
        if self.rope != self.simulation.rope:
            raise StudioError("demonstrations are on a rope of 1 m by 10 mm: lay another rope")
        self.state.apply(action)
        self.draft = Draft(self.points, self.state, action, self.simulation.rope)
        self.simulated = None
        return self.draft

    def simulate(self) -> Attempts:
        """Simulate the draft; `success[0]` says whether the state was reached."""
        if self.draft is None:
            raise StudioError("choose an action to demonstrate first")
        draft, spline = self.draft, self.draft.spline[None]
        with self._busy:
            found = attempt(self.simulator, draft.points, spline, draft.action, draft.state)
        self.simulated = found
        return found

    def keep(self, who: str) -> Demonstration:
        """Append the simulated draft to `file`, signed, and end it."""
        if self.draft is None or self.simulated is None:
            raise StudioError("simulate a demonstration before you keep it")
        if not np.array_equal(self.simulated.splines[0], self.draft.spline):
            raise StudioError("the clicks have changed since: simulate them again")
        if not self.simulated.success[0]:
            raise StudioError("it did not reach its state, so nothing can be learned from it: redo")
        if not who.strip():
            raise StudioError("write your name first: who demonstrated is kept, too")
        draft, when = self.draft, datetime.now(UTC).astimezone().isoformat(timespec="seconds")
        of = task_at(draft.state, draft.action)
        demonstration = Demonstration(of, draft.points, draft.spline, "human", who.strip(), when)
        add_demonstration(self.file, demonstration)
        self.draft = self.simulated = None
        return demonstration

    def kept(self) -> list[Demonstration]:
        """The demonstrations of `file`."""
        return load_demonstrations(self.file) if self.file.exists() else []

    @contextmanager
    def _while_idle(self) -> Iterator[None]:
        """A block that is refused while something runs, and in which nothing else does."""
        if not self._busy.acquire(blocking=False):
            raise StudioError("a search or a simulation is running: wait for it, or stop it")
        try:
            yield
        finally:
            self._busy.release()


@contextmanager
def _uploaded(*files: tuple[str, bytes]) -> Iterator[list[Path]]:
    """Files that came through the browser; errors name them as the person knows them."""
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for number, (name, content) in enumerate(files):
            paths.append(Path(folder) / str(number) / Path(name).name)
            paths[-1].parent.mkdir()
            paths[-1].write_bytes(content)
        try:
            yield paths
        except ValueError as error:
            text = re.sub(rf"{re.escape(folder)}/\d+/", "", str(error))
            named = any(path.name in text for path in paths)
            error.args = (text if named else f"{', '.join(name for name, _ in files)}: {text}",)
            raise
