"""Where commands write: paths that are free and writable, and the folder of a plan, which is
planned again only if what was asked for, or the code that plans, is another."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping
from contextlib import AbstractContextManager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knotflow.planning import KnotPlan
    from knotflow.simulation import Attempts, RopeConfig


LIBRARIES = ("mujoco", "numpy", "torch")
"""Of these a plan depends on the version."""


def version_text() -> str:
    """Name and version of the package, as `knotflow --version` prints them."""
    try:
        return f"knotflow {version('knotflow')}"
    except PackageNotFoundError:
        return "knotflow, unknown version: not installed"


def provenance() -> dict[str, str]:
    """Version, code and weights on which a plan depends."""
    import knotflow
    from knotflow.samplers.primitives import SHIPPED_PRIMITIVES

    source = Path(knotflow.__file__).parent
    packages = ("topology", "simulation", "samplers", "planning")
    code = [path for name in packages for path in (source / name).rglob("*.py")]
    found = {"knotflow": version_text().removeprefix("knotflow ")}
    found["code"] = digest(*sorted([*source.glob("*.py"), *code]))
    found["libraries"] = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return found | {"primitives": digest(*sorted(Path(SHIPPED_PRIMITIVES).iterdir()))}


def arm_digest(arm: str, base: Path | None) -> str:
    """Of what decides what an arm reaches."""
    import knotflow

    source = Path(knotflow.__file__).parent / "execution"
    code = sorted([*source.rglob("*.py"), *source.rglob("*.xml")])
    given = [path for path in (Path(arm), base) if path is not None and path.is_file()]
    return digest(*code, *given)


def digest(*files: Path) -> str:
    """Of the contents of files, 16 characters."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def stored_outcome(
    folder: Path, request: Mapping[str, Any], overwrite: bool
) -> dict[str, Any] | None:
    """The outcome of the same request, unless it is to be overwritten.

    Raises:
        ValueError: the folder holds another plan, or other files, or cannot be written.
    """
    from knotflow.viz.plan_folder import OUTCOME, REQUEST

    if folder.is_file():
        raise ValueError(f"--out {folder} is a file; a plan needs a folder")
    if not (folder / REQUEST).is_file():
        if folder.exists() and any(folder.iterdir()):
            raise ValueError(f"{folder} holds files, but no plan; name another folder with --out")
    elif not overwrite and (folder / OUTCOME).is_file():
        stored = _stored_values(folder / REQUEST)
        if stored == request:
            return _stored_values(folder / OUTCOME, "text", "success")
        differing = ", ".join(
            f"{key} {stored.get(key)!r} there and {request.get(key)!r} here"
            for key in sorted({*stored, *request})
            if stored.get(key) != request.get(key)
        )
        raise ValueError(
            f"{folder} holds another plan ({differing}); --overwrite replaces it, "
            "--out DIR writes elsewhere"
        )
    check_writable(folder)
    return None


def _stored_values(file: Path, *names: str) -> dict[str, Any]:
    """The values in a file of a plan's folder; raises `ValueError` where these are not among
    them."""
    try:
        values = json.loads(file.read_text("utf-8"))
    except ValueError:
        values = None
    if not isinstance(values, dict) or not {*names} <= values.keys():
        raise ValueError(f"{file} is damaged; --overwrite replaces the plan")
    return values


def write_plan(
    folder: Path,
    found: KnotPlan,
    last: Attempts | None,
    rope: RopeConfig,
    request: Mapping[str, Any],
) -> None:
    """Write a plan's folder, its outcome last."""
    from knotflow.viz.plan_folder import OUTCOME, PLAN_FILES, write_plan_folder

    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".tmp-", dir=folder.parent) as name:
        made = Path(name)
        write_plan_folder(made, found, "primitives", rope, last_tried=last, request=request)
        folder.mkdir(exist_ok=True)
        for file in (OUTCOME, *PLAN_FILES):
            (folder / file).unlink(missing_ok=True)
        for path in sorted(made.iterdir(), key=lambda path: path.name == OUTCOME):
            path.replace(folder / path.name)


def atomic(path: Path) -> AbstractContextManager[Path]:
    """A temporary path that becomes `path` on leaving, see `workflow.store.atomic`."""
    from knotflow.workflow import store  # slow to import

    return store.atomic(path)


def check_free(path: Path, option: str = "--out") -> None:
    """Raises `ValueError` where something is already, or nothing can be written."""
    if path.exists():
        raise ValueError(f"{path} exists already; name another file with {option}")
    check_writable(path)


def check_writable(path: Path) -> None:
    """Raises `ValueError` where nothing can be written."""
    place = path.absolute()
    folder = next((one for one in place.parents if one.exists()), place)
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        raise ValueError(f"cannot write {path}: {folder} is not a writable folder") from None
