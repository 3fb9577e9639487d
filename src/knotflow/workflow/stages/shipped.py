"""Stage `shipped`: a trained library as files small enough to be kept with the source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from knotflow.samplers.primitives import FILE, PrimitiveLibrary
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass
class ShippedConfig:
    """Nothing to choose."""


@stage("shipped", inputs=("primitives",))
def ship(config: ShippedConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes primitives/primitive-<number>.safetensors in half precision."""
    library = PrimitiveLibrary.load(inputs["primitives"] / FILE)
    with context.atomic("primitives") as folder:
        folder.mkdir()
        for number, primitive in library.primitives.items():
            actions = {number: library.trained_on[number]}
            one = PrimitiveLibrary({number: primitive}, actions, library.rope)
            one.save(folder / f"primitive-{number}.safetensors", half=True)
