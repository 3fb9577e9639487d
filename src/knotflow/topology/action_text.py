"""Actions as text: parsing their short form, and describing them in a sentence."""

from __future__ import annotations

import re
from dataclasses import fields

from knotflow.topology.action import ARRANGE, UNDO, Action, Arrange, IllegalActionError, Undo
from knotflow.topology.moves import ACTION_KINDS, R1, R2, Cross
from knotflow.topology.state import TopologicalState

_SIDES = {1: "left", -1: "right"}
_SIGNS = {1: "+", -1: "-"}
_FORM = re.compile(rf"\s*({UNDO}\s+)?(\w+)\s*\((\s*[+-]?\d+\s*(?:,\s*[+-]?\d+\s*)*)\)\s*")


def parse_action(text: str) -> Action:
    """Read an action from its `str`: "C(2,0,1)", "undo C(2,0,1)" or "arrange for C(2,0,1)".

    Raises:
        IllegalActionError: not an action; the message lists the forms there are.
    """
    kinds = {kind.symbol: kind for kind in ACTION_KINDS}
    names = {symbol: [field.name for field in fields(kind)] for symbol, kind in kinds.items()}
    valid = ", ".join(f"{symbol}({','.join(own)})" for symbol, own in names.items())
    if not isinstance(text, str):
        raise IllegalActionError(f"{text!r} is not the text of an action; valid forms: {valid}")
    valid += f", and each of them after {UNDO!r}, and all of these after {ARRANGE!r}"
    if text.strip().startswith(ARRANGE):
        return Arrange(parse_action(text.strip().removeprefix(ARRANGE)))
    match = _FORM.fullmatch(text)
    parameters = [int(word) for word in match[3].split(",")] if match else []
    if match is None or len(parameters) != len(names.get(match[2], ())):
        raise IllegalActionError(f"{text!r} is not an action; valid forms: {valid}")
    action = kinds[match[2]](*parameters)
    return Undo(action) if match[1] else action


def describe(action: Action, state: TopologicalState) -> str:
    """A sentence on what a legal action does to a rope in a state, and the state it leads to.

    Left and right are as seen when walking along the segment from head to tail.

    Raises:
        IllegalActionError: the state does not allow the action; says which rule it breaks.
    """
    after = state.apply(action)
    if isinstance(action, Arrange):
        return (
            f"{action}: move the rope without changing its crossings, so that there is room to "
            f"{_describe_motion(action.wanted, state)}; {state} stays."
        )
    return f"{action}: {_describe_motion(action, state)}; {state} becomes {after}."


def _segment_name(segment: int, state: TopologicalState) -> str:
    """A segment in words, such as "the head (segment 0)"."""
    if state.num_segments == 1:
        return "the rope (segment 0)"
    if segment in (0, state.num_segments - 1):
        return f"the {'tail' if segment else 'head'} (segment {segment})"
    return f"segment {segment}"


def _describe_motion(action: Action, state: TopologicalState) -> str:
    over = _segment_name(action.over_segment, state)
    under = _segment_name(action.under_segment, state)
    match action:
        case R1(left=left, sign=sign):
            top = "strand nearer the tail" if left == sign else "strand nearer the head"
            return (
                f"twist a loop into {over}, on its {_SIDES[left]}, with the {top} on top, "
                f"which makes a crossing of sign {_SIGNS[sign]}"
            )
        case R2(left=left, over_first=over_first):
            if action.over == action.under:
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
            return f"pull {over} straight, which removes its crossing"
        case Undo():
            count = state.num_segments
            pulled = _segment_name(action.pulled_segment(count), state)
            other = _segment_name(action.other_segment(count), state)
            direction = "from under" if pulled == under else "off"
            removed = "crossing" if isinstance(action.action, Cross) else "two crossings"
            return f"pull {pulled} {direction} {other}, which removes their {removed}"
    raise TypeError(f"cannot describe the action {action!r}")
