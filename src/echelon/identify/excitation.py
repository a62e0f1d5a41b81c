"""What the data at hand show of the parameters that the sensors could see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Direction:
    """A combination of base parameters that the data hardly show.

    Attributes
    ----------
    singular_value : float
        Of the weighted observation matrix with columns of norm 1, relative to the largest.
    weights : mapping-like tuple of (str, float)
        Parameters with their shares in the combination, largest first, small ones left out.
    advice : str
        How to excite it, in a sentence.
    """

    singular_value: float
    weights: tuple[tuple[str, float], ...]
    advice: str


@dataclass(frozen=True)
class Excitation:
    """Conditioning of a set of data.

    Attributes
    ----------
    condition, scaled_condition : float
        Condition number of the weighted observation matrix, and with columns of norm 1.
    singular_values : array of shape (n,)
        Of the scaled matrix, descending.
    rank : int
        Directions that the data determine at all.
    visibility : array of shape (n,)
        For each parameter 1/√(VIF): the share of its column that no other column explains, 0 to 1.
    weak : tuple of Direction
        Combinations that the data leave open, or nearly so.
    """

    condition: float
    scaled_condition: float
    singular_values: Floats
    rank: int
    visibility: Floats
    weak: tuple[Direction, ...]
