"""Numbers that people give, as arrays: what is none is refused in words that say which."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray


def floats(
    values: ArrayLike, what: str, error: type[ValueError] = ValueError
) -> NDArray[np.float64]:
    """Values as an array of float64.

    Args:
        values: numbers, or lists of them.
        what: they are, for the message.
        error: to raise.

    Raises:
        ValueError: `error`; they are no numbers, or lists of different lengths.
    """
    try:
        return np.asarray(values, np.float64)
    except (ValueError, TypeError, OverflowError) as wrong:
        raise error(f"{what} must be numeric, in lists of equal length: {wrong}") from None


def read_npy(path: Path) -> NDArray:
    """The array of an NPY file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no NPY file, a damaged one, or one of Python objects.
    """
    try:
        loaded = np.load(path, allow_pickle=False)
    except OSError:
        raise
    except MemoryError:
        raise ValueError("it announces more numbers than fit into memory") from None
    except Exception as error:  # its header is parsed as Python and fails in as many ways
        what = "Python objects, or no NumPy file" if "pickle" in str(error) else str(error)
        raise ValueError(what or "no NumPy file") from None
    if not isinstance(loaded, np.ndarray):
        loaded.close()
        raise ValueError("several arrays, in a .npz file")
    return loaded
