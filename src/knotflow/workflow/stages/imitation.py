"""Stage `imitation`: four primitives learn from the demonstrations (Sec. V-B a and b)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from knotflow.samplers.demonstrations import SHIPPED, TASKS, Task, load_trials
from knotflow.samplers.primitives import (
    FILE,
    PRIMITIVES,
    PrimitiveConfig,
    PrimitiveLibrary,
    primitive_of,
)
from knotflow.simulation import RopeConfig, Trials
from knotflow.topology import Action
from knotflow.training import Imitation, ImitationConfig
from knotflow.training.trainer import CURVES, merge_curves, run_training
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass(kw_only=True)
class ImitationStageConfig:
    """What learns, and how long."""

    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope of the demonstrations; a library remembers it."""
    primitive: PrimitiveConfig = field(default_factory=PrimitiveConfig)
    """Networks, their variant, and the search."""
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    """The effort."""
    seed: int
    """Of weights and batches."""


@stage("imitation", inputs=("demonstrations",))
def imitate(
    config: ImitationStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes primitives.safetensors and curves.csv; one part a primitive, resumed by validation."""
    parts = [f"primitive-{number}" for number in PRIMITIVES]
    work = partial(_imitate, config, dict(inputs))
    context.each(work, context.pending(parts, ".safetensors"), "imitation")
    merge(context, parts)


def _imitate(
    config: ImitationStageConfig, inputs: Mapping[str, Path], context: StageContext, part: str
) -> None:
    number = number_of(part)
    trials = demonstrated(number, load_trials(inputs["demonstrations"]))
    training = Imitation(
        list(trials.values()),
        config.primitive,
        config.imitation,
        config.seed + number,
    )

    def finish() -> None:
        actions = {number: list(trials)}
        library = PrimitiveLibrary({number: training.primitive}, actions, config.rope)
        with context.atomic(f"{part}.safetensors") as path:
            library.save(path)

    run_training(
        training, context.out / part, name=f"imitation {number}", progress=context.progress,
        save_every=10, finish=finish, log=log_to(context, number),
    )  # fmt: skip


def log_to(context: StageContext, number: int) -> Callable[[str, float, int], None]:
    """Logs the metrics of a primitive's training."""

    def log(name: str, value: float, step: int) -> None:
        context.logger.log_scalar(f"primitive_{number}/{name}", value, step)

    return log


def demonstrated(
    number: int, trials: Mapping[Action, Sequence[Trials]]
) -> dict[Action, list[Trials]]:
    """Of all trials those that a primitive, 1 to 4, learns from.

    Actions beyond the eight tasks are among them, if somebody has demonstrated some.

    Raises:
        ValueError: there are none.
    """
    chosen: dict[Action, list[Trials]] = {}
    for action, some in trials.items():
        own = [one for one in some if primitive_of(action, one.start.num_segments) == number]
        if own:
            chosen[action] = own
    if not chosen:
        raise ValueError(
            f"there is no demonstration for primitive {number}, which learns "
            f"{', '.join(str(task.action) for task in tasks_of(number))} and the like; demonstrate "
            f"one, or merge the file with the shipped demonstrations: knotflow merge FILE {SHIPPED}"
        )
    return chosen


def number_of(part: str) -> int:
    """The primitive that "primitive-3" names."""
    return int(part.rpartition("-")[2])


def tasks_of(number: int) -> list[Task]:
    """The tasks of a primitive, 1 to 4."""
    return [
        task for task in TASKS if primitive_of(task.action, task.start_state.num_segments) == number
    ]


def merge(context: StageContext, parts: list[str]) -> None:
    """Bring the parts of a library, and their curves, into one file each."""
    with context.atomic(FILE) as path:
        libraries = [PrimitiveLibrary.load(context.out / f"{part}.safetensors") for part in parts]
        PrimitiveLibrary.merged(libraries).save(path)
    curves = {number_of(part): context.out / part / CURVES for part in parts}
    with context.atomic(CURVES) as path:
        merge_curves(curves).to_csv(path, index=False, float_format="%.6g")
