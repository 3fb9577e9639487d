"""Topological actions in words: what each does to the rope, for those who do not read Table I."""

from __future__ import annotations

from knotflow.topology.action import Action
from knotflow.topology.actions import R1, R2, Cross
from knotflow.topology.arrange import Arrange
from knotflow.topology.state import TopologicalState
from knotflow.topology.undo import Undo

_SIDES = {1: "left", -1: "right"}
_SIGNS = {1: "+", -1: "-"}


def describe(action: Action, state: TopologicalState) -> str:
    """One sentence on what a legal action does to a rope in a state, and what state it leads to.

    Left and right are those of someone who walks along the segment from head to tail.

    Raises:
        IllegalActionError: the state does not allow the action; says which rule it breaks.
    """
    after = state.apply(action)
    if isinstance(action, Arrange):
        return (
            f"{action}: move the rope without changing its crossings, so that there is room to "
            + (_deed(action.wanted, state) + f"; {state} stays.")
        )
    return f"{action}: {_deed(action, state)}; {state} becomes {after}."


def segment_name(segment: int, state: TopologicalState) -> str:
    """A segment in words, such as "the head (segment 0)"."""
    if state.num_segments == 1:
        return "the rope (segment 0)"
    if segment in (0, state.num_segments - 1):
        return f"the {'tail' if segment else 'head'} (segment {segment})"
    return f"segment {segment}"


def _deed(action: Action, state: TopologicalState) -> str:
    over = segment_name(action.over_segment, state)
    under = segment_name(action.under_segment, state)
    match action:
        case R1(left=left, sign=sign):
            top = "strand nearer the tail" if left == sign else "strand nearer the head"
            return (
                f"twist a loop into {over}, on its {_SIDES[left]}, with the {top} on top, "
                f"which makes a crossing of sign {_SIGNS[sign]}"
            )
        case R2(over=same, under=other, left=left, over_first=over_first):
            if same == other:
                half = "head" if over_first == 1 else "tail"
                return (
                    f"fold {over} to its {_SIDES[left]} and lay a finger of its half nearer the "
                    f"{half} over the other half, which makes two crossings of opposite signs"
                )
            return (
                f"pull a finger of {over} out to its {_SIDES[left]} and lay it over {under}, "
                "which makes two crossings of opposite signs"
            )
        case Cross(sign=sign):
            return (
                f"lay {over} over {under}, which makes a crossing of sign {_SIGNS[sign]}: along "
                f"the upper strand, the lower one runs to the {_SIDES[sign]}"
            )
        case Undo(action=R1()):
            return f"pull {over} straight, which takes its crossing back"
        case Undo():
            count = state.num_segments
            pulled = segment_name(action.pulled_segment(count), state)
            off = segment_name(action.other_segment(count), state)
            way = "from under" if pulled == under else "off"
            made = "crossing" if isinstance(action.action, Cross) else "two crossings"
            return f"pull {pulled} {way} {off}, which takes their {made} back"
    raise TypeError(f"no words for the action {action!r}")
