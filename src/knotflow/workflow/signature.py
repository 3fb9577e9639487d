"""The identity of a stage's output: a hash of everything that decides it, and of nothing else.

Only the standard library is used, so that the same configuration gives the same signature in every
process, on every platform and Python version.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path, PurePath
from typing import Any, TypeVar

T = TypeVar("T")
AFFECTS_RESULT = "affects_result"
_INSTALLED = Path(__file__).parents[2]  # where the package is
LENGTH = 16  # hex digits, 64 bits: no two of a million configurations meet by chance


def runtime(
    default: T | Any = dataclasses.MISSING,
    *,
    default_factory: Callable[[], T] | Any = dataclasses.MISSING,
) -> Any:
    """A dataclass field that cannot change the result: threads, device, logging.

    It is left out of the signature, so another value of it finds the same finished stage.
    """
    make: Any = dataclasses.field  # its overloads know no "either of the two"
    return make(default=default, default_factory=default_factory, metadata={AFFECTS_RESULT: False})


def signature(
    stage: str,
    version: int,
    config: Any,
    input_signatures: Mapping[str, str] | None = None,
    packages: Mapping[str, int] | None = None,
) -> str:
    """16 hex digits over a stage's name, versions, configuration and inputs' signatures.

    Args:
        stage: registered name of the stage.
        version: of the stage's own code.
        config: a dataclass instance (nested ones as you like); fields declared with `runtime` are
            left out, the order of fields does not count.
        input_signatures: input name -> signature of the stage output it comes from.
        packages: package that the stage uses -> its version, see `knotflow.versions`.

    Raises:
        TypeError: a value has no canonical form; says which.
    """
    identity = {
        "stage": stage,
        "version": version,
        "config": plain(config, with_runtime=False),
        "inputs": dict(input_signatures or {}),
        "packages": dict(packages or {}),
    }
    return hashlib.sha256(canonical_json(identity).encode()).hexdigest()[:LENGTH]


def canonical_json(value: Any) -> str:
    """One text for one value: keys sorted, no spaces, ASCII, floats by `repr`."""
    return json.dumps(plain(value), sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def plain(value: Any, *, with_runtime: bool = True, _key: str = "") -> Any:
    """Nested dicts, lists, strings, numbers, booleans and None that say the same as `value`.

    Enums become their names, paths their POSIX form, tuples lists, sets sorted lists.

    Raises:
        TypeError: a value of another type; the message has its key.
    """

    def inner(item: Any, name: object) -> Any:
        return plain(item, with_runtime=with_runtime, _key=f"{_key}.{name}" if _key else str(name))

    if isinstance(value, Enum):  # before str and int: an enum may be both
        return value.name
    if value is None or isinstance(value, bool):
        return value
    for kind in (str, int, float):
        if isinstance(value, kind):
            return kind(value)
    if isinstance(value, PurePath):
        return value.as_posix()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: inner(getattr(value, field.name), field.name)
            for field in dataclasses.fields(value)
            if with_runtime or affects_result(field)
        }
    if isinstance(value, Mapping):
        return {str(plain(key)): inner(item, key) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [inner(item, index) for index, item in enumerate(value)]
    if isinstance(value, set | frozenset):
        return sorted((inner(item, "{}") for item in value), key=canonical_json)
    raise TypeError(
        f"{_key or 'the configuration'} is {value!r} of type {type(value).__name__}; a signature "
        "can be made of dataclasses, mappings, sequences, sets, str, int, float, bool, None, "
        "enums and paths"
    )


def runtime_fields(value: Any, prefix: str = "") -> dict[str, Any]:
    """The fields that were left out of the signature, by dotted key: {"simulation.threads": 2}.

    A path into the package begins with the package's name, wherever it is installed.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        found: dict[str, Any] = {}
        for field in dataclasses.fields(value):
            key, item = f"{prefix}{field.name}", getattr(value, field.name)
            if affects_result(field):
                found |= runtime_fields(item, f"{key}.")
            else:
                found[key] = _from_package(plain(item))
        return found
    items: Any = ()
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    return {
        key: item
        for name, child in items
        for key, item in runtime_fields(child, f"{prefix}{plain(name)}.").items()
    }


def _from_package(value: Any) -> Any:
    """A text that names a file or folder of the package, from the package on; else as it is."""
    if isinstance(value, str) and Path(value).is_relative_to(_INSTALLED):
        return Path(value).relative_to(_INSTALLED).as_posix()
    return value


def affects_result(field: dataclasses.Field[Any]) -> bool:
    """Whether another value of this field may give another result (unless declared: yes)."""
    return bool(field.metadata.get(AFFECTS_RESULT, True))
