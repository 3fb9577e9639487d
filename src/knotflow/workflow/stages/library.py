"""Stage `library`: trained primitives from a file, such as those that ship with the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from knotflow.samplers.primitives import FILE, PrimitiveLibrary
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage


@dataclass(kw_only=True)
class LibraryConfig:
    """Which library."""

    file: str = runtime("")
    """A library's file, or a folder of files; what counts is `contents`."""
    contents: str
    """Digest of what the file or folder holds."""


@stage("library", inputs=())
def take(config: LibraryConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes primitives.safetensors, as the stages that train do.

    Raises:
        FileNotFoundError, LibraryError: see `PrimitiveLibrary.load`.
    """
    library = PrimitiveLibrary.load(Path(config.file))
    with context.atomic(FILE) as path:
        library.save(path)
