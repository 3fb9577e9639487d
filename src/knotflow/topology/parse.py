"""Actions as text."""

from __future__ import annotations

import re
from dataclasses import fields

from knotflow.topology.action import Action, IllegalActionError
from knotflow.topology.actions import ACTION_KINDS
from knotflow.topology.arrange import ARRANGE, Arrange
from knotflow.topology.undo import UNDO, Undo

_FORM = re.compile(rf"\s*({UNDO}\s+)?(\w+)\s*\(([^()]*)\)\s*")


def parse_action(text: str) -> Action:
    """Read an action from its `str`: "C(2,0,1)", "undo C(2,0,1)" or "arrange for C(2,0,1)".

    Raises:
        IllegalActionError: not an action; the message lists the forms there are.
    """
    forms = {kind.symbol: [field.name for field in fields(kind)] for kind in ACTION_KINDS}
    valid = ", ".join(f"{symbol}({','.join(names)})" for symbol, names in forms.items())
    if not isinstance(text, str):
        raise IllegalActionError(f"{text!r} is not an action's text; valid forms: {valid}")
    valid += f", and each of them after {UNDO!r}, and all of these after {ARRANGE!r}"
    if text.strip().startswith(ARRANGE):
        return Arrange(parse_action(text.strip().removeprefix(ARRANGE)))
    match = _FORM.fullmatch(text)
    kinds = {kind.symbol: kind for kind in ACTION_KINDS}
    if match is None or match[2] not in kinds:
        raise IllegalActionError(f"{text!r} is not an action; valid forms: {valid}")
    try:
        values = [int(word) for word in match[3].split(",")]
    except ValueError:
        raise IllegalActionError(f"{text!r}: parameters must be whole numbers: {valid}") from None
    if len(values) != len(forms[match[2]]):
        raise IllegalActionError(
            f"{text!r}: {match[2]} takes {len(forms[match[2]])} parameters, got {len(values)}; "
            f"valid forms: {valid}"
        )
    action = kinds[match[2]](*values)
    return Undo(action) if match[1] else action
