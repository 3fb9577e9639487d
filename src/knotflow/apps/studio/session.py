"""What a person does in the studio, without a browser: a rope, plans for it, demonstrations on it.

Nothing here draws or asks; `page` does. A method that simulates takes its seconds in the thread
that calls it, one at a time: the simulator is not to be shared.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotflow.apps.studio.draft import Draft
from knotflow.apps.studio.drawn import lay_drawn
from knotflow.planning import (
    ROPE_NAMES,
    KnotPlan,
    RopeInputError,
    SearchUpdate,
    parse_goal,
    parse_rope,
    plan_knot,
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

if TYPE_CHECKING:
    from knotflow.samplers.primitives import PrimitiveLibrary

STARTS = {f"start of {one.action}": str(one.action) for one in TASKS if one.start_actions}
ROPES = (*ROPE_NAMES, *STARTS)
"""Ropes to choose from: generated, or a start shape of a shipped demonstration."""
HUMAN = "human"
"""The source of what is demonstrated here."""


class StudioError(ValueError):
    """Something that cannot be done now; says what has to come first."""


class Stopped(Exception):
    """A search was stopped by the person who had begun it."""


@dataclass(frozen=True, eq=False)
class SimulatedProposals:
    """What the library proposes for an action, simulated.

    Attributes:
        attempts: the proposals, best value first.
        values: (N,) the critic's probability that each succeeds; NaN without a critic.
    """

    attempts: Attempts
    values: NDArray[np.float64]


class Session:
    """A rope on the table, and what was made of it.

    Attributes:
        file: where kept demonstrations go (JSON lines).
        points: (V, 3) the rope at rest, metres.
        state: its topological state.
        plan: the last one for this rope, if any.
        draft: the demonstration in the making, if any.
        tried: the draft's simulation, if it was simulated.
    """

    def __init__(
        self,
        rope: str = "straight",
        file: Path = Path("demonstrations.jsonl"),
        simulation: SimulationConfig | None = None,
        seed: int = 0,
    ) -> None:
        """Lay a rope that `load` knows; its errors are those of `load`."""
        self.file = Path(file)
        self.simulation = simulation or SimulationConfig()
        self._rng = np.random.default_rng(seed)
        self._busy = threading.Lock()
        self.load(rope)

    @cached_property
    def simulator(self) -> RopeSimulator:
        """Executes splines."""
        return RopeSimulator(self.simulation)

    @cached_property
    def library(self) -> PrimitiveLibrary:
        """The shipped primitives."""
        from knotflow.config import shipped_primitives  # slow: the page is there before
        from knotflow.samplers.primitives import PrimitiveLibrary

        return PrimitiveLibrary.load(Path(shipped_primitives()), self.simulation.rope)

    # The rope.

    def lay(self, points: NDArray) -> None:
        """Lay a rope (V, 3), metres; what was planned or begun with the one before is gone.

        Raises:
            DegenerateCurveError: its state cannot be read.
            StudioError: the one before is being worked on.
        """
        if self._busy.locked():
            raise StudioError("a search or a simulation is running: wait for it, or stop it")
        self.state = TopologicalState.from_curve(points)
        self.points: NDArray[np.float64] = np.array(points, np.float64)
        self.plan: KnotPlan | None = None
        self.draft: Draft | None = None
        self.tried: Attempts | None = None

    def load(self, rope: str) -> None:
        """Lay a rope: one of `ROPES`, or a CSV or NPY file.

        Raises:
            RopeInputError: see `planning.read_rope`.
        """
        if rope in STARTS:
            wanted = task(STARTS[rope])
            shapes = [one.points for one in load_demonstrations() if one.task == wanted]
            self.lay(resample(shapes[self._rng.integers(len(shapes))], self.simulation.rope))
        else:
            self.lay(parse_rope(rope, self.simulation.rope, self._rng))

    def load_upload(self, name: str, content: bytes) -> None:
        """Lay the rope of a file that came through the browser; see `load`."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(name).name
            path.write_bytes(content)
            try:
                self.load(str(path))
            except RopeInputError as error:  # the person knows the file by its name
                raise RopeInputError(str(error).replace(f"{folder}/", "")) from None

    def draw(self, clicked: NDArray) -> None:
        """Lay a rope along points (N, 2) clicked on the table, head first; see `lay_drawn`."""
        self.lay(lay_drawn(clicked, self.simulation.rope))

    def see(self, files: Mapping[str, bytes]) -> tuple[str, ...]:
        """Lay the rope of an image.

        Args:
            files: contents of the images `rgb` and `depth` (PNG), and of the `camera` (YAML).

        Returns:
            What is in doubt, in words.

        Raises:
            ImageError, CameraError, TraceError: see `perception.estimate`.
        """
        from knotflow.perception import Camera, RgbdImage, estimate

        with tempfile.TemporaryDirectory() as folder:
            paths = {"rgb": "rgb.png", "depth": "depth.png", "camera": "camera.yaml"}
            for name, file in paths.items():
                (Path(folder) / file).write_bytes(files[name])
            camera = Camera.load(Path(folder) / paths["camera"])
            image = RgbdImage.read(
                Path(folder) / paths["rgb"], Path(folder) / paths["depth"], camera
            )
        with self._busy, one_thread():
            found = estimate(image, camera, self.simulation.rope)
        self.lay(found.points)
        return found.in_doubt

    # Plans.

    def search(
        self,
        knot: str,
        progress: Callable[[SearchUpdate], None],
        stop: threading.Event | None = None,
        max_seconds: float = 60.0,
    ) -> KnotPlan:
        """Plan a knot, see `planning.parse_goal`, for the rope as it lies.

        Raises:
            ValueError: no such knot, or no way to it from this rope.
            Stopped: `stop` was set.
        """
        from knotflow.config import PlanRequest

        goal = parse_goal(knot, self.simulation.rope)
        config = PlanRequest().planner
        config.max_seconds = max_seconds

        def report(update: SearchUpdate) -> None:
            progress(update)
            if stop is not None and stop.is_set():
                raise Stopped

        with self._busy, one_thread():
            self.plan = plan_knot(
                self.points, goal, self.library, self.simulator, self._rng, config, report
            )
        return self.plan

    def propose(self, action: Action, count: int = 6) -> SimulatedProposals:
        """What the library proposes for an action now, and what becomes of it.

        Raises:
            ValueError: no primitive instantiates it.
        """
        with self._busy, one_thread():
            splines, values = self.library.valued(self.points, action, count, self._rng)
            order = np.argsort(-values, kind="stable")
            tried = attempt(self.simulator, self.points, splines[order], action, self.state)
        return SimulatedProposals(tried, values[order])

    # Demonstrations.

    def actions(self) -> list[Action]:
        """The actions that the rope's state allows; first the tasks that start in it."""
        common = [one.action for one in TASKS if one.start_state == self.state]
        legal = dict.fromkeys(action for action, _ in self.state.actions())
        return sorted(legal, key=lambda action: (action not in common, str(action)))

    def begin(self, action: Action) -> Draft:
        """Begin a demonstration of a legal action, in place of the one before.

        Raises:
            IllegalActionError: the rope's state does not allow it.
        """
        self.state.apply(action)
        height = self.draft.height if self.draft else Draft.height
        self.draft = Draft(self.points, self.state, action, self.simulation.rope, height)
        self.tried = None
        return self.draft

    def simulate(self) -> Attempts:
        """Simulate the draft; `success[0]` says whether the state was reached.

        Raises:
            StudioError, ClickError: there is no draft, or it lacks clicks.
        """
        if self.draft is None:
            raise StudioError("choose an action to demonstrate first")
        splines, draft = self.draft.spline[None], self.draft
        with self._busy:
            self.tried = attempt(self.simulator, draft.points, splines, draft.action, draft.state)
        return self.tried

    def keep(self, who: str) -> Demonstration:
        """Append the simulated draft to `file`, signed, and end it.

        Raises:
            StudioError: nothing was simulated, it did not reach its state, or nobody signs it.
        """
        if self.draft is None or self.tried is None:
            raise StudioError("simulate a demonstration before you keep it")
        if not np.array_equal(self.tried.splines[0], self.draft.spline):
            raise StudioError("the clicks have changed since: simulate them again")
        if not self.tried.success[0]:
            raise StudioError("it did not reach its state, so nothing can be learnt from it: redo")
        if not who.strip():
            raise StudioError("write your name first: who demonstrated is kept, too")
        demonstration = Demonstration(
            task_at(self.draft.state, self.draft.action),
            self.draft.points,
            self.draft.spline,
            HUMAN,
            who.strip(),
            datetime.now(UTC).astimezone().isoformat(timespec="seconds"),
        )
        add_demonstration(self.file, demonstration)
        self.draft = self.tried = None
        return demonstration

    def kept(self) -> list[Demonstration]:
        """The demonstrations of `file`; see `load_demonstrations` for its errors."""
        return load_demonstrations(self.file) if self.file.exists() else []
