"""Arrays from user input, with errors that name what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def floats(
    values: ArrayLike, what: str, error: type[ValueError] = ValueError
) -> NDArray[np.float64]:
    """Values as a float64 array.

    Args:
        values: numbers, or lists of them.
        what: the name of the values in the error message.
        error: the type of error to raise.

    Raises:
        ValueError: `error`; the values are not numeric, or lists of different lengths.
    """
    try:
        return np.asarray(values, np.float64)
    except (ValueError, TypeError, OverflowError) as wrong:
        raise error(f"{what} must be numeric, in lists of equal length: {wrong}") from None


def read_npy(path: Path) -> NDArray[Any]:
    """The array of an NPY file.

    Raises:
        OSError: the file cannot be read.
        ValueError: not an NPY file, a damaged one, or one of Python objects.
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
