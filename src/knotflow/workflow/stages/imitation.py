"""Stage `imitation`: four primitives learn from the demonstrations (Sec. V-B a and b)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from knotflow.samplers.demonstrations import SHIPPED, TASKS, Task, Trials, load_trials
from knotflow.samplers.primitives import (
    FILE,
    PRIMITIVES,
    PrimitiveConfig,
    PrimitiveLibrary,
    primitive_of,
)
from knotflow.simulation import RopeConfig
from knotflow.topology import Action, segment_intervals
from knotflow.training import Imitation, ImitationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.curves import Curves


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
    curves = Curves(context, part)
    if checkpoint := curves.checkpoint():
        training.load(checkpoint)
    bar = context.progress(
        total=config.imitation.validations, initial=len(curves), desc=f"imitation {number}"
    )
    with bar:
        for metrics in training:
            curves.add(number, metrics)
            bar.update()
            if len(curves) % 10 == 0:
                with curves.saving() as folder:
                    training.save(folder)
    curves.save()
    library = PrimitiveLibrary({number: training.primitive}, {number: list(trials)}, config.rope)
    with context.atomic(f"{part}.safetensors") as path:
        library.save(path)


def demonstrated(number: int, trials: Mapping[Action, Trials]) -> dict[Action, Trials]:
    """Of all trials those that a primitive, 1 to 4, learns from.

    Actions beyond the eight tasks are among them, if somebody has demonstrated some.

    Raises:
        ValueError: there are none.
    """
    chosen: dict[Action, Trials] = {}
    for action, some in trials.items():
        segments = [len(segment_intervals(points)) for points in some.starts]
        own = np.flatnonzero([primitive_of(action, count) == number for count in segments])
        if len(own):
            chosen[action] = some.from_starts(own)
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
    Curves.merge(context, parts)
