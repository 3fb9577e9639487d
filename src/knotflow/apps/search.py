"""What `plan`, `next` and `run` share: a measured rope, a plan kept in a file, and the search.

Heavy modules are imported inside the functions, as in `apps.cli`.
"""

from __future__ import annotations

import warnings
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from knotflow import planning  # its names are loaded when they are used
from knotflow.planning.config import FAST_SEARCH, RopeOptions

if TYPE_CHECKING:
    from knotflow.simulation import Attempts, RopeConfig


@dataclass(frozen=True)
class ArmOptions:
    """An arm that is to follow what is planned."""

    arm: str | None = None
    """Accept only plans for this arm: panda, ur5e, xarm7, or an MJCF or URDF file."""
    base: Path | None = None
    """As in `knotflow export`, with --arm."""
    tip: str | None = None
    """As in `knotflow export`, with --arm."""

    def __post_init__(self) -> None:
        if self.arm is None and (self.base is not None or self.tip is not None):
            raise ValueError("--base and --tip need --arm")

    def check(self) -> None:
        """Raises `ValueError` or `OSError` where there is no such arm, tip or base."""
        if self.arm is not None:
            from knotflow.execution.arm.model import Base, find_arm

            find_arm(self.arm, self.tip)
            if self.base is not None:
                Base.load(self.base)


NO_ARM = ArmOptions()


def read_rope(
    rope: str | planning.RopeTable, options: RopeOptions | None, seed: int
) -> planning.MeasuredRope:
    """A rope of a word, a file or a table, see `planning.measured_rope`; prints its remarks.

    Raises:
        ValueError: it cannot be read, or not be grasped.
    """
    from knotflow.seeding import rng_of

    found = planning.measured_rope(rope, options or RopeOptions(), rng_of(seed, 0))
    check_thickness(found.rope)
    for remark in found.remarks:
        print(remark)
    return found


def check_thickness(rope: RopeConfig) -> None:
    """Raises `ValueError` where a rope does not fit between the open fingers."""
    hand = planning.HandConfig()
    most = hand.opening - 2 * hand.clearance
    if 2 * rope.radius > most:
        raise ValueError(
            f"a rope of {rope.length:.3g} m by {2e3 * rope.radius:.3g} mm: the fingers grasp "
            f"{1e3 * most:.3g} mm at most; give its --diameter"
        )


def load_plan(file: Path) -> planning.KnotPlan:
    """The plan in a JSON file; raises `ValueError` if it is none."""
    try:
        return planning.KnotPlan.from_json(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def kept_plan(file: Path, knot: str, measured: planning.MeasuredRope) -> planning.KnotPlan | None:
    """The plan that a file keeps, if it exists, for the model of a rope measured anew.

    Raises:
        ValueError: it is no plan, or one for another knot.
    """
    if not file.exists():
        return None
    kept = load_plan(file)
    if set(kept.goal_states) != set(planning.parse_goal(knot, measured.rope).states):
        raise ValueError(f"{file} keeps a plan for {kept.goal}: name another file for {knot}")
    kept = kept.placed(planning.Placement(1 / measured.placement.length), planning.Frame())
    return resampled(kept, measured)


def resampled(kept: planning.KnotPlan, measured: planning.MeasuredRope) -> planning.KnotPlan:
    """A plan for the model with as many vertices as it has now: the length was measured anew."""
    from knotflow.simulation import resample

    if all(len(one.start) == len(measured.points) for one in kept.steps):
        return kept
    steps = (replace(one, start=resample(one.start, measured.model)) for one in kept.steps)
    return replace(kept, steps=tuple(steps))


def find_plan(
    knot: str,
    measured: planning.MeasuredRope,
    earlier: planning.KnotPlan | None = None,
    *,
    seed: int,
    max_seconds: float,
    margin: float,
    worlds: int,
    error: float = 0.0,
    arm: ArmOptions = NO_ARM,
) -> tuple[planning.KnotPlan, Attempts | None]:
    """The plan for the model of the rope, solved or not, and the last attempts, if any.

    Args:
        earlier: a plan for this rope to go on with.
        margin: least length between crossings, metres.
        worlds: see `planning.SurvivalConfig`.
        error: standard deviation of the gripper's errors in these worlds, metres.
    """
    from tqdm import tqdm

    from knotflow.samplers.primitives import SHIPPED_PRIMITIVES, PrimitiveLibrary
    from knotflow.samplers.primitives.library import UnlikeRopeWarning
    from knotflow.seeding import rng_of
    from knotflow.simulation import RopeConfig, SimulationConfig, WorldsConfig

    goal = planning.parse_goal(knot, measured.rope)  # refuses it before the slow import
    if doubts := measured.size.doubts(goal):
        print(doubts)
    library = PrimitiveLibrary.load(Path(SHIPPED_PRIMITIVES), RopeConfig())
    length = measured.size.length
    config = replace(FAST_SEARCH, max_seconds=max_seconds, margin=margin / length)
    survival = planning.SurvivalConfig(worlds)
    if error:  # and what follows is planned again, so that the worlds may be milder
        survival.spread = WorldsConfig(error=error / length)
    reach = measured.hand
    if arm.arm is not None:
        from knotflow.execution import ArmReach

        carried = ArmReach(
            arm.arm, arm.base, arm.tip, simulation=SimulationConfig(rope=measured.model),
            placement=measured.placement, frame=replace(measured.frame, unit="m"),
        )  # fmt: skip
        reach = replace(reach, arm=carried)
    tried: deque[Attempts] = deque(maxlen=1)
    bar = tqdm(desc="simulated", unit=" splines", disable=None)

    def show(update: planning.SearchUpdate) -> None:
        if update.survival:
            bar.set_postfix_str(f"ties in {update.survival:.0%} of worlds", refresh=False)
        bar.update(update.branches - bar.n)

    with bar, warnings.catch_warnings(record=True) as unlike:
        warnings.simplefilter("always", UnlikeRopeWarning)
        found = planning.plan_rope(
            measured.points, knot, rng_of(seed, 1),
            sampler=library, simulation=SimulationConfig(rope=measured.model), config=config,
            progress=show, observe=tried.append, survival=survival, reach=reach, earlier=earlier,
            stoppable=not error,  # a plan that is not executed at once
            early=True,
        )  # fmt: skip
    for warning in unlike:
        print(warning.message)
    return found, tried[-1] if tried else None
