"""A studio session without a browser: a rope, plans for it, and demonstrations on it.

A method that simulates blocks the thread that calls it; only one runs at a time.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Mapping
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
    KnotPlan,
    RopeInputError,
    SearchUpdate,
    parse_rope,
    plan_rope,
)
from knotflow.samplers.demonstrations import (
    TASKS,
    Demonstration,
    add_demonstration,
    load_demonstrations,
    task,
    task_at,
)
from knotflow.simulation import Attempts, RopeSimulator, SimulationConfig, attempt, resample
from knotflow.threads import one_thread
from knotflow.topology import Action, TopologicalState
from knotflow.viz.plan_folder import subsample

if TYPE_CHECKING:
    from knotflow.samplers.primitives import PrimitiveLibrary

STARTS = {f"start of {one.action}": str(one.action) for one in TASKS if one.start_actions}
ROPES = (*ROPE_NAMES, *STARTS)
"""Ropes to choose from: generated, or a start shape of a shipped demonstration."""


class StudioError(ValueError):
    """Something that cannot be done now; names what has to come first."""


class Session:
    """A rope on the table, its plan and its demonstration.

    Attributes:
        file: of the kept demonstrations (JSON lines).
        points: (V, 3) the rope at rest, metres.
        plan: the last one for this rope, if any.
        draft: the demonstration in the making, if any.
        simulated: the draft's simulation, if any.
    """

    def __init__(self, rope: str = "straight", file: Path = Path("demonstrations.jsonl")) -> None:
        """Lay a rope: one of `ROPES`, or a file; see `planning.parse_rope` for its errors."""
        self.file = file
        self.simulation = SimulationConfig()
        self._rng = np.random.default_rng(0)
        self._busy = threading.Lock()
        if rope in ROPES:
            self.lay_named(rope)
        else:
            self.lay(parse_rope(rope, self.simulation.rope, self._rng))

    @cached_property
    def simulator(self) -> RopeSimulator:
        return RopeSimulator(self.simulation)

    @cached_property
    def library(self) -> PrimitiveLibrary:
        """The shipped primitives."""
        from knotflow.samplers.primitives import SHIPPED_PRIMITIVES, PrimitiveLibrary  # slow

        return PrimitiveLibrary.load(SHIPPED_PRIMITIVES, self.simulation.rope)

    def lay(self, points: NDArray) -> None:
        """Lay a rope (V, 3), metres; the previous plan and draft are dropped.

        Raises:
            DegenerateCurveError: its state cannot be read.
            StudioError: a search or simulation is running.
        """
        if self._busy.locked():
            raise StudioError("a search or a simulation is running: wait for it, or stop it")
        self.state = TopologicalState.from_curve(points)
        self.points: NDArray[np.float64] = np.array(points, np.float64)
        self.plan: KnotPlan | None = None
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

    def lay_upload(self, name: str, content: bytes) -> None:
        """Lay the rope of a file that came through the browser."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(name).name
            path.write_bytes(content)
            try:
                self.lay(parse_rope(str(path), self.simulation.rope, self._rng))
            except RopeInputError as error:  # the person knows the file by its name
                raise RopeInputError(str(error).replace(f"{folder}/", "")) from None

    def lay_image(self, files: Mapping[str, bytes]) -> tuple[str, ...]:
        """Lay the rope of an image, and return what is ambiguous in it.

        `files` are the contents of `rgb` and `depth` (PNG), and of `camera` (YAML or JSON).

        Raises:
            ImageError, CameraError, TraceError: see `perception.estimate`.
        """
        from knotflow.perception import estimate, read_capture

        with tempfile.TemporaryDirectory() as folder:
            home = Path(folder)
            paths = home / "rgb.png", home / "depth.png", home / "camera.yaml"
            for path in paths:
                path.write_bytes(files[path.stem])
            seen = read_capture(*paths)
        with self._busy, one_thread():
            found = estimate(seen.image, seen.camera, self.simulation.rope)
        self.lay(found.points)
        return found.all_ambiguities

    def search(
        self, knot: str, progress: Callable[[SearchUpdate], None], max_seconds: float = 60.0
    ) -> KnotPlan:
        """Plan a knot for the rope, see `planning.plan_rope`; what `progress` raises ends it."""
        with self._busy:
            config = replace(FAST_SEARCH, max_seconds=max_seconds)
            plan = plan_rope(
                self.points, knot, self._rng,
                sampler=self.library, simulation=self.simulation, config=config, progress=progress,
            )  # fmt: skip
        self.plan = subsample(plan)
        return self.plan

    def actions(self) -> list[Action]:
        """The actions that the rope's state allows; first the tasks that start in it."""
        common = [one.action for one in TASKS if one.start_state == self.state]
        legal = dict.fromkeys(action for action, _ in self.state.actions())
        return sorted(legal, key=lambda action: (action not in common, str(action)))

    def begin(self, action: Action) -> Draft:
        """Begin a demonstration of a legal action, in place of the one before."""
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
