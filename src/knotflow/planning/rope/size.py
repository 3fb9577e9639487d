"""The size of a rope, and the rope of 1 m in whose units it is planned for.

Lengths are divided by the rope's length and times by the square root of its length in metres:
gravity is unchanged, and a rope of the same proportions moves exactly alike.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from knotflow.planning.config import RopeOptions
from knotflow.planning.frame import METRES
from knotflow.planning.rope.files import RopeInputError
from knotflow.simulation import NOMINAL, RopeConfig, rope_of, usual_links

if TYPE_CHECKING:
    from knotflow.planning.goals import Goal

DIAMETER = 2.0 * NOMINAL.radius / NOMINAL.length
"""Of a rope of which only the length is known, in its lengths: that of the model rope."""
STIFFNESS = {"soft": 0.5, "medium": 1.0, "stiff": 2.0}
"""Bending lengths relative to that of a rope as thick and of the model rope's material."""
THINNEST, THICKEST = 1 / 500, 1 / 20
"""Diameters in lengths of the rope; thinner ropes are simulated as the thinnest."""
SOFTEST, STIFFEST = 1 / 500, 0.15
"""Bending lengths in lengths of the rope; from 0.2 on, simulations diverge."""
LENGTHS = (0.01, 100.0)
"""Of a rope, metres."""
USUAL_LENGTHS = (0.05, 20.0)
"""Metres; outside, a length has to state its unit."""
FIGURE_EIGHT = 13
"""Bending lengths of rope that a figure eight takes, measured (docs/design.md, Planning)."""
FEW = 3
"""Crossings of an overhand, which takes less."""

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*(mm|cm|m|)\s*", re.IGNORECASE)


def parse_metres(text: str, what: str, zero: bool = False) -> float:
    """Metres in a text such as 6mm, 0.7 m or 0.7.

    Raises:
        RopeInputError: it is no length, or 0 and not `zero`; says of `what`.
    """
    match = _QUANTITY.fullmatch(text)
    value = float(match[1]) * METRES[match[2].lower() or "m"] if match else -1.0
    if not 0.0 <= value < 1e6 or (value == 0.0 and not zero):
        raise RopeInputError(f"{what} {text!r} is no length: write 6mm, 0.6cm or 0.006")
    return value


def parse_length(text: str) -> float:
    """Metres in the text of a rope's length.

    Raises:
        RopeInputError: it is no length, of no rope, or unusual and without a unit.
    """
    length, has_unit = parse_metres(text, "--length"), text.strip()[-1].isalpha()
    low, high = LENGTHS if has_unit else USUAL_LENGTHS
    if not low <= length <= high:
        bare = "" if has_unit else "without a unit (m, cm, mm), "
        raise RopeInputError(f"--length {text}: {bare}a rope is {low:g} to {high:g} m long")
    return length


@dataclass(frozen=True)
class RopeSize:
    """Length, diameter and bending length, metres; see `STIFFNESS`."""

    length: float
    diameter: float
    bending_length: float

    @classmethod
    def of(
        cls, length: float, diameter: str | None = None, stiffness: str | None = None
    ) -> RopeSize:
        """A rope of a length, metres; by default of the model's proportions and material.

        Raises:
            RopeInputError: texts that cannot be read, or a diameter or bending length out of range.
        """
        thick = DIAMETER * length if diameter is None else parse_metres(diameter, "--diameter")
        if thick > THICKEST * length * (1 + 1e-9):
            raise RopeInputError(
                f"--diameter {diameter}: {thick:g} m is more than a twentieth of the rope's length "
                f"of {length:.3g} m; units are m, cm and mm, as in 6mm"
            )
        stiffness = stiffness or "medium"
        if stiffness not in STIFFNESS:
            try:
                bending = parse_metres(stiffness, "--stiffness")
            except RopeInputError:
                raise RopeInputError(
                    "--stiffness soft, medium, stiff or a bending length such as 4cm, not "
                    f"{stiffness!r}"
                ) from None
            if not SOFTEST * length <= bending <= STIFFEST * length:
                raise RopeInputError(
                    f"--stiffness {stiffness}: a bending length of {bending:g} m is not between "
                    f"{SOFTEST * length:.2g} and {STIFFEST * length:.2g} m; units are m, cm and "
                    "mm, as in 4cm"
                )
            return cls(length, thick, bending)
        # Of one material, stiffness grows with the fourth power of thickness, weight by the second.
        relative = STIFFNESS[stiffness] * (thick / (2.0 * NOMINAL.radius)) ** (2 / 3)
        bending = min(max(relative * NOMINAL.bending_length, SOFTEST * length), STIFFEST * length)
        return cls(length, thick, bending)

    @classmethod
    def of_options(cls, options: RopeOptions) -> RopeSize:
        """A rope of given options, of the model rope's length where they have none; see `of`."""
        length = parse_length(options.length) if options.length else NOMINAL.length
        return cls.of(length, options.diameter, options.stiffness)

    def rope(self, links: int | None = None) -> RopeConfig:
        """The rope in its real size, of the model's proportions and material."""
        model, length = self.model(links), self.length
        torque = length**4  # of weights, length cubed, and levers
        return replace(
            model,
            length=length,
            radius=0.5 * self.diameter,
            density=model.density * (2 * model.radius * length / self.diameter) ** 2,
            joint_stiffness=torque * model.joint_stiffness,
            joint_damping=torque * length**0.5 * model.joint_damping,
            joint_armature=torque * length * model.joint_armature,
        )

    @property
    def links(self) -> int:
        """Links of the model rope, unless its shape needs more."""
        return usual_links(self.diameter / self.length)

    def model(self, links: int | None = None) -> RopeConfig:
        """The rope of 1 m that moves alike, of the model rope's mass and damping a metre."""
        thickness = max(self.diameter / self.length, THINNEST)
        return rope_of(thickness, self.bending_length / self.length, links or self.links)

    def doubts(self, goal: Goal) -> str:
        """Why a knot can hardly be tied into a rope of this size, or ''."""
        least = FIGURE_EIGHT * self.bending_length
        if self.length >= least or min(state.num_crossings for state in goal.states) <= FEW:
            return ""
        return (
            f"the rope is probably too short for its stiffness: of a bending length of "
            f"{1e2 * self.bending_length:.2g} cm, a figure eight takes {least:.2g} m"
        )

    def describe(self) -> str:
        """Its three lengths for printing."""
        told = (
            f"rope of {self.length:.3g} m by {1e3 * self.diameter:.3g} mm, bending length "
            f"{1e2 * self.bending_length:.2g} cm"
        )
        if self.diameter < THINNEST * self.length:
            told += f"; simulated {1e3 * THINNEST * self.length:.2g} mm thick, the least there is"
        return told
