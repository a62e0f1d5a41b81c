"""Arrays packed for a page: as 32-bit floats in base 64, more digits than a screen shows."""

from __future__ import annotations

from base64 import b64encode

import numpy as np
import numpy.typing as npt


def packed(values: npt.ArrayLike) -> str:
    """An array in row-major order, little endian."""
    with np.errstate(over="ignore"):
        return b64encode(np.asarray(values, dtype=float).astype("<f4").tobytes()).decode("ascii")
