"""The key of a stage's output: a hash of everything that decides it, and of nothing else."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

AFFECTS_RESULT = "affects_result"
"""Metadata of a dataclass field; False for one that cannot change a result, such as threads."""
LENGTH = 16  # hex digits


def key_of(parts: Mapping[str, Any]) -> str:
    """16 hex digits over plain data, the same in every process and on every platform."""
    return hashlib.sha256(canonical_json(parts).encode()).hexdigest()[:LENGTH]


def canonical_json(value: Any) -> str:
    """One text for one value: keys sorted, no spaces, ASCII, floats by `repr`."""
    return json.dumps(plain(value), sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def digest(path: Path) -> str:
    """Hash of the contents of a file, or of a folder's files and their names.

    Raises:
        FileNotFoundError: there is nothing at `path`.
    """
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    total = hashlib.sha256()
    for file in files:
        if file.is_file() or not path.is_dir():
            name = file.relative_to(path).as_posix() if path.is_dir() else ""
            total.update(f"{name}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return total.hexdigest()[:LENGTH]


def plain(value: Any, where: str = "") -> Any:
    """Nested dicts, lists, strings, numbers, booleans and None that say the same as `value`.

    Dataclass fields that cannot change a result are left out. Enums become their names, paths
    their POSIX form, tuples lists, sets sorted lists.

    Raises:
        TypeError: a value of another type; the message has its place.
    """
    if isinstance(value, Enum):  # before str and int: an enum may be both
        return value.name
    if value is None or isinstance(value, bool | str | int | float):
        return value
    if isinstance(value, PurePath):
        return value.as_posix()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: plain(getattr(value, field.name), f"{where}.{field.name}")
            for field in dataclasses.fields(value)
            if field.metadata.get(AFFECTS_RESULT, True)
        }
    if isinstance(value, Mapping):
        return {str(plain(name)): plain(item, f"{where}.{name}") for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, f"{where}.{index}") for index, item in enumerate(value)]
    if isinstance(value, set | frozenset):
        return sorted((plain(item, where) for item in value), key=canonical_json)
    raise TypeError(
        f"{where.lstrip('.') or 'a value'} is {value!r} of type {type(value).__name__}; keys are "
        "made of dataclasses, mappings, sequences, sets, str, int, float, bool, None, enums, paths"
    )
