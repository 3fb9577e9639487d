"""Arrays from user input, with errors that name what is wrong, and weights to files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from torch import Tensor


def floats(
    values: ArrayLike, what: str, error: type[ValueError] = ValueError
) -> NDArray[np.float64]:
    """Values as a float64 array.

    Raises:
        ValueError: `error`, with `what` they are; not numeric, or lists of different lengths.
    """
    try:
        return np.asarray(values, np.float64)
    except (ValueError, TypeError, OverflowError) as wrong:
        raise error(f"{what} must be numeric, in lists of equal length: {wrong}") from None


def repeat_last(rows: NDArray[Any], frames: int) -> NDArray[Any]:
    """Rows (B, T, ...) of T or more `frames`, the last one repeated."""
    return rows[:, np.minimum(np.arange(frames), rows.shape[1] - 1)]


def read_npy(path: Path) -> NDArray[Any]:
    """The array of an NPY file.

    Raises:
        OSError: the file cannot be read.
        ValueError: not an NPY file, a damaged one, or one of Python objects.
    """
    with path.open("rb") as file:
        try:
            loaded: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
        except Exception as error:  # its header is parsed as Python and fails in as many ways
            raise ValueError(f"no NumPy file of one array of numbers: {error}") from None
    return loaded


def read_weights(
    path: Path | str, error: type[ValueError] = ValueError
) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Metadata and weights of a safetensors file.

    Raises:
        ValueError: `error`; there is no such file, or another one.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "pt") as file:
            return file.metadata() or {}, {name: file.get_tensor(name) for name in file.keys()}
    except (OSError, SafetensorError) as wrong:
        raise error(f"{path}: is missing, damaged or no safetensors file: {wrong}") from None


def save_weights(
    path: Path | str, weights: Mapping[str, Tensor], about: dict[str, str], half: bool = True
) -> None:
    """Write weights (by default in half precision) and metadata to a safetensors file, whose bytes
    depend on these alone."""
    from safetensors.torch import save

    tensors = {
        name: (one.half() if half and one.is_floating_point() else one).contiguous()
        for name, one in weights.items()
    }
    written = save(tensors, about)
    end = 8 + int.from_bytes(written[:8], "little")
    header = json.loads(written[8:end])
    header["__metadata__"] = dict(sorted(about.items()))  # the library writes it in any order
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    Path(path).write_bytes(len(text).to_bytes(8, "little") + text + written[end:])
