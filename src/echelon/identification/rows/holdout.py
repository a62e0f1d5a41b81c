"""Data that the fit does not see: held out by time or by trajectory, never by random samples.

Neighbouring samples share their noise, their filters and their place on the trajectory, so that a random sample held
out is all but known to the fit.  What is held out here is contiguous, and each part is filtered on its own: near its
ends the filter over both sides treats regressor and outputs alike, whatever it lacks, so no measured output enters both
parts and none is lost.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.logs.recording import Samples

SHARE = 0.3
"""Share of the data that is held out unless said otherwise."""


def split(samples: Samples, share: float = SHARE, guard: int = 0) -> tuple[Samples, Samples]:
    """The first part of a segment for the fit, the last for validation.

    Parameters
    ----------
    samples : Samples
        One segment.
    share : float
        Part of its time that is held out, between 0 and 1.
    guard : int
        Samples to leave out on either side of the cut.

    Returns
    -------
    fit, held : Samples
        With arrays of their own samples only.

    Raises
    ------
    InputError
        If the share or guard is out of range, or the segment is too short.
    """
    if not 0 < share < 1 or guard < 0:
        raise InputError(f"a share of {share:g} with a guard of {guard} samples; expected 0 < share < 1, guard ≥ 0")
    stop = len(samples) if samples.stop is None else samples.stop
    cut = samples.first + int(np.floor((1 - share) * (stop - samples.first)))
    factor = 1 if samples.reduction is None else samples.reduction.factor
    if cut - guard - samples.first < factor or stop - cut - guard < factor:
        raise InputError(
            f"{stop - samples.first} samples cannot be split {1 - share:.0%} to {share:.0%} with {guard} samples "
            "left out on either side of the cut; give a longer log, or hold out a log of its own",
            source=samples.source,
        )
    held = replace(_part(samples, cut, len(samples)), first=guard, stop=stop - cut)
    return replace(_part(samples, 0, cut), stop=cut - guard), held


def _part(samples: Samples, begin: int, end: int) -> Samples:
    """Some of the samples, as a segment that knows nothing of the others."""

    def cut(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return values[begin:end]

    return replace(
        samples,
        start=samples.start + begin / samples.rate,
        q=cut(samples.q),
        qd=cut(samples.qd),
        qdd=cut(samples.qdd),
        y=None if samples.y is None else cut(samples.y),
        inputs={name: cut(values) for name, values in samples.inputs.items()},
        moving=None if samples.moving is None else samples.moving[begin:end],
        first=max(samples.first - begin, 0),
        stop=None if samples.stop is None else min(samples.stop, end) - begin,
    )
