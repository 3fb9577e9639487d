"""What people type after `python -m knotflow`, checked and completed before Hydra reads it.

Hydra speaks of config groups and grammars; people ask for experiments, misspell keys, and paste a
knot as the help writes it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_type_hints

from knotflow.config import Config, PlanRequest

PASSED_ON = {
    *("--help", "-h", "--hydra-help", "--cfg", "-c", "--info", "-i"),
    *("--shell-completion", "-sc"),
}
"""Options that need no experiment."""

SHORT = tuple(one.name for one in fields(PlanRequest))
"""Keys that people may write without their `plan.`."""

LAUNCHERS = {
    "joblib": ("hydra_joblib_launcher", "launchers"),
    "submitit_local": ("hydra_submitit_launcher", "launchers"),
    "submitit_slurm": ("hydra_submitit_launcher", "launchers"),
    "ray": ("hydra_ray_launcher", "launcher-ray"),
}
"""Hydra's launchers: the plugin of each, and our extra that installs it."""

_TEXTS = ("plan.knot", "plan.rope", "plan.primitives")


class OverrideError(ValueError):
    """Words that no experiment takes."""


def checked(words: list[str], home: Path) -> list[str]:
    """The words after the command as Hydra takes them.

    Args:
        words: as typed.
        home: holds conf/ and workflows/.

    Raises:
        OverrideError: no or an unknown experiment, key or launcher, or a key that the experiment
            has no use for; names the valid ones.
    """
    words = [re.sub(r"^(\+\+)?experiment=", "+experiment=", word) for word in words]
    if PASSED_ON & set(words):
        return words
    names = sorted(path.stem for path in (home / "conf" / "experiment").glob("*.yaml"))
    asked = [word.partition("=")[2] for word in words if word.startswith("+experiment=")]
    known = f"experiments are: {', '.join(names)}"
    if not asked:
        raise OverrideError(f"choose one with +experiment=NAME; {known}")
    for name in asked[0].split(","):
        if name not in names:
            raise OverrideError(f"there is no experiment {name!r}; {known}")
        words = [_planned(word, name, home) for word in words]
    for word in words:
        key, given, value = word.partition("=")
        if given and not key:
            raise OverrideError(f"{word!r} has no key before its =; {known}")
        if given and key == "hydra/launcher":
            _check_launcher(value)
        if given and key[0] not in "+~" and not re.search(r"[@/]|^hydra\b|^budget$", key):
            _check_key(key)
            _check_seed(key, value)
    return [_quoted(word) for word in words]


def _planned(word: str, experiment: str, home: Path) -> str:
    """A word that says what to plan, in full; refused where the experiment has no use for it."""
    key = re.split(r"[.=]", word.removeprefix("plan."))[0]
    if key not in SHORT or "=" not in word:
        return word
    workflow = home / "workflows" / f"{experiment}.yaml"
    text = workflow.read_text("utf-8") if workflow.is_file() else ""  # paper has none of its own
    takes = [one for one in SHORT if f"${{plan.{one}}}" in text]
    if key not in takes:
        raise OverrideError(
            f"{word!r} says what to plan, but the experiment {experiment} takes "
            f"{', '.join(takes) or 'nothing of that kind'}; +experiment=overhand plans one"
        )
    return f"plan.{word.removeprefix('plan.')}"


def _quoted(word: str) -> str:
    """A knot or a path as text: brackets and signs are grammar to Hydra. Lists of a sweep stay."""
    key, _, value = word.partition("=")
    if key not in _TEXTS or value[:1] in "'\"" or re.fullmatch(r"[\w./,-]+", value):
        return word
    return f"{key}='{value.replace(chr(39), chr(92) + chr(39))}'"


def _check_key(key: str) -> None:
    """Refuse a key that the configuration does not have, with the nearest that it has."""
    within: Any = Config
    parts = key.split(".")
    for depth, part in enumerate(parts):
        if not is_dataclass(within):
            return  # a dict, such as a workflow's: anything goes
        types = get_type_hints(within)
        name = part.partition("[")[0]
        if name not in types:
            every = list(_keys(Config))
            near = [one for one in every if one.rpartition(".")[2] == parts[-1]]
            near += difflib.get_close_matches(key, [*every, *SHORT], 3)
            place = ".".join(parts[:depth])
            if near and not place:  # some other place's key
                raise OverrideError(f"there is no key {key!r}: did you mean {_either(near)}?")
            hint = f"did you mean {_either(near)}? " if near else ""
            has = f"{place or 'the configuration'} has {', '.join(types)}"
            raise OverrideError(f"there is no key {key!r}: {hint}{has}")
        within = types[name]


def _either(keys: list[str]) -> str:
    return " or ".join(dict.fromkeys(keys))


def _keys(config: Any, prefix: str = "") -> Iterator[str]:
    """Every dotted key of a configuration class, leaves alone."""
    for name, kind in get_type_hints(config).items():
        if is_dataclass(kind):
            yield from _keys(kind, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def _check_seed(key: str, value: str) -> None:
    if key.endswith("seed") and re.search(r"(^|,)\s*-\d", value):
        raise OverrideError(f"{key} must be 0 or more, got {value}")


def _check_launcher(name: str) -> None:
    if name not in LAUNCHERS:
        return  # Hydra's own, or somebody's
    plugin, extra = LAUNCHERS[name]
    try:
        installed = find_spec(f"hydra_plugins.{plugin}") is not None
    except ModuleNotFoundError:  # no plugin at all
        installed = False
    if not installed:
        raise OverrideError(
            f"hydra/launcher={name} needs the extra {extra!r}: pip install 'knotflow[{extra}]'"
        )
