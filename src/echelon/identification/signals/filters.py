"""Filters without phase, over positions and over both sides of the equation; and derivatives of sampled signals.

Recursive filters run forwards and then backwards, because positions, velocities and torques must keep their common
time.  Butterworth for signals, because its pass-band is flat, so that amplitudes and with them parameters stay.
Sections of second order because one polynomial of order 4 already loses its digits at a cut-off of a thousandth of the
rate.  As everywhere in the field a cut-off is that of one pass (−3 dB), so that both together take 6 dB there.  How
far a result depends on its neighbours has a closed form: the response to an impulse is Σ c p^|lag| over the poles p,
with residues c of H(z) H(1/z), and so is its tail.

A model that is linear in its parameters stays true when every column of the regressor and the outputs pass the same
linear filter (Gautier's parallel filter); noise above the band of the motion goes, and so does the work.  The usual
choice is a symmetric finite filter that is computed only where samples remain, in two steps where few of them do: a
million samples of 250 columns take about a third of a second on one processor.  Kaiser's window, because its length
has a formula and its attenuation can be asked for.

The derivatives of a polynomial of degree 8 through nine neighbouring samples: of all differentiators of its length the
flattest.  Up to a sixth of the rate their gain is right to two thousandths, where three samples miss the first one
by a sixth; so they fit logs of 30 Hz as well as of 5 kHz, and cost four samples at each end.  They smooth nothing:
noise is the business of the low-pass before them.  Weights: Fornberg, Math. Comp. 51, 1988.

Orientations are unit quaternions.  A quaternion and its negative are the same orientation, and logs jump between them:
the sign is made continuous first.  Then the four entries are filtered and differentiated like any signals.  What the
filter does to their length is undone by dividing by it; for motions far below the cut-off this is the smoothing on the
manifold itself, since the two differ by a term of third order in the angle turned within the filter's memory.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from math import isfinite

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from echelon.shared import Floats, InputError, extra

Complexes = npt.NDArray[np.complex128]

LOWEST = 1e-6
"""Lowest cut-off as a share of the rate: a filter below it would be longer than any log."""

NEAR = 3e-2
"""Influence of what lies beyond the end of a signal, below which a result is not spoilt by it: the signal turned about
its end, which is taken for it there, is far from wrong."""

ATTENUATION = 80.0
"""Attenuation above the pass-band, dB: noise is rarely a ten-thousandth of the signal."""

ORDER = 4
"""Order of Butterworth filters: 24 dB per octave and pass."""

PASSED = 0.8
"""Share of the band below half the rate that finite filters pass: narrower transitions need longer filters."""

WORTH = PASSED / 2
"""Highest cut-off that is worth a filter, as a share of the rate: above it a transition has no room."""

WIDEST = 0.5
"""Widest transition between pass-band and stop-band, as a share of the cut-off."""

_LAST_STEP = 4
"""Samples of which the last of two filters keeps one: the first one then has a wide transition and few taps."""


@dataclass(frozen=True, eq=False)
class ZeroPhase:
    """A recursive filter that runs forwards and backwards."""

    zeros: Complexes  # of one pass, in the z-plane
    poles: Complexes
    gain: float

    def reach(self, influence: float) -> int:
        """Samples on either side, beyond which all others together count for less than this share of the largest."""
        size = np.abs(self.poles)
        weights = np.abs(self._residues()) / (1 - size)

        def is_beyond(lag: int) -> bool:
            return 2 * float(weights @ size**lag) <= influence

        longest = range(int(1 / LOWEST**2))
        return bisect_left(longest, True, lo=1, key=is_beyond)

    def apply(self, values: Floats, padding: int) -> Floats:
        """The filtered values (N, …); ``padding`` samples continue each end, turned about it."""
        with extra("identify"):
            from scipy.signal import sosfiltfilt, zpk2sos

        sections = zpk2sos(self.zeros, self.poles, self.gain)  # type: ignore[arg-type]  # complex, as they must be
        length = min(padding, len(values) - 1)
        return sosfiltfilt(sections, values, axis=0, padlen=length)

    def _residues(self) -> Complexes:
        """Coefficients c of the response Σ c p^|lag| to an impulse."""
        found = np.empty(len(self.poles), complex)
        # a pole at zero, which forgets everything in one sample, has no residue of this form
        smallest = np.sqrt(np.finfo(float).eps)
        poles = np.where(np.abs(self.poles) < smallest, smallest, self.poles)
        for k, pole in enumerate(poles):
            others = np.delete(poles, k)
            forwards = self.gain * np.prod(pole - self.zeros) / np.prod(pole - others)
            backwards = (
                self.gain * np.prod(1 / pole - self.zeros) / np.prod(1 / pole - poles)
            )
            found[k] = forwards * backwards / pole
        return found


def butterworth(cutoff: float, rate: float, order: int = ORDER) -> ZeroPhase:
    """A Butterworth low-pass forwards and backwards; one pass takes 3 dB at the cut-off, Hz."""
    with extra("identify"):
        from scipy.signal import butter

    check_cutoff(cutoff, rate)
    if not 1 <= order <= 12:
        raise InputError(
            f"order {order} of a Butterworth filter: expected a whole number from 1 to 12"
        )
    zeros, poles, gain = butter(order, cutoff, fs=rate, output="zpk")
    return ZeroPhase(
        np.asarray(zeros, complex), np.asarray(poles, complex), float(gain)
    )


def lowpass(values: Floats, cutoff: float, rate: float, order: int = ORDER) -> Floats:
    """Butterworth low-pass of values (N, …) without delay; cut-off in Hz, ``inf`` for no filter."""
    if cutoff == np.inf:
        return np.array(values, dtype=np.float64)
    both = butterworth(cutoff, rate, order)
    return both.apply(values, 2 * both.reach(NEAR))


def check_cutoff(cutoff: float, rate: float) -> None:
    """Refuse a cut-off, Hz, that is not between a millionth of the rate and half of it."""
    if not (isfinite(cutoff) and LOWEST * rate <= cutoff < rate / 2):
        raise InputError(
            f"a cut-off of {cutoff:g} Hz is impossible at {rate:g} samples per second: expected more than "
            f"{LOWEST * rate:g} Hz and less than {rate / 2:g} Hz, or inf for no filter"
        )


@dataclass(frozen=True, eq=False)
class FirFilter:
    """A symmetric finite filter that keeps every k-th sample, and is computed where samples remain.

    Another one may come before, at a higher rate: to leave few samples in two steps takes a third of the products.
    """

    taps: Floats  # shape (2 length + 1,); symmetric, with sum 1
    step: int = 1
    before: FirFilter | None = None

    @property
    def factor(self) -> int:
        """Samples of which one remains."""
        return self.step * (self.before.factor if self.before else 1)

    @property
    def reach(self) -> int:
        """Samples on either side that a result depends on."""
        own = len(self.taps) // 2
        if self.before is None:
            return own
        return self.before.reach + own * self.before.factor

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain, each ``factor``-th: shape (N, …) to (kept, …).

        Near its ends, where a part of the filter lies outside the signal, the part inside is scaled to sum 1: a mean of
        what is there.  Both sides of an equation are still filtered alike, so no row is spoilt.
        """
        values = (
            np.asarray(values, dtype=np.float64)
            if self.before is None
            else self.before.apply(values)
        )
        table = np.ascontiguousarray(values.reshape(len(values), -1))
        half, results = len(self.taps) // 2, -(-len(table) // self.step)
        found = np.empty((results, table.shape[1]))
        first, last = -(-half // self.step), (len(table) - 1 - half) // self.step + 1
        if first < last:
            windows = sliding_window_view(
                table[first * self.step - half :], len(self.taps), axis=0
            )[:: self.step]
            np.matmul(
                self.taps, windows[: last - first].swapaxes(1, 2), out=found[first:last]
            )
        for row in (k for k in range(results) if not first <= k < last):
            start = row * self.step - half
            taps = self.taps[max(0, -start) : len(table) - start]
            found[row] = (
                taps @ table[max(0, start) : start + len(self.taps)] / taps.sum()
            )
        return found.reshape(results, *values.shape[1:])


def fir_lowpass(
    cutoff: float, rate: float, factor: int = 1, *, width: float | None = None
) -> FirFilter:
    """A symmetric finite low-pass by Kaiser's window, with decimation.

    The pass-band ends at the cut-off, Hz.  The stop-band begins ``width`` Hz above it; by default that is half the
    cut-off, or as much as decimation leaves.
    """
    with extra("identify"):
        from scipy.signal import firwin, kaiserord

    check_cutoff(cutoff, rate / factor)
    if width is None:
        width = min(WIDEST * cutoff, rate / factor - 2 * cutoff)
    if width < LOWEST * rate:
        raise InputError(
            f"a filter whose edge is {width:g} Hz wide is too long at {rate:g} samples per second"
        )
    count, beta = kaiserord(ATTENUATION, 2 * width / rate)
    taps = firwin(
        2 * (count // 2) + 1, cutoff + width / 2, window=("kaiser", beta), fs=rate
    )
    taps = (taps + taps[::-1]) / 2
    return FirFilter(taps / taps.sum(), factor)


def reduction(edge: float, rate: float) -> FirFilter | None:
    """The filter over both sides of the equation that keeps the band up to an edge, Hz, and samples enough for it.

    None where the edge is so near half the rate that no filter is worth it.  The last of two filters sees four times
    as many samples as remain; what the first one folds lies above the edge of the last.
    """
    if edge > WORTH * rate:
        return None
    factor = int(PASSED * rate / 2 / edge)
    first = factor // _LAST_STEP
    if first < _LAST_STEP:
        return fir_lowpass(edge, rate, max(1, factor))
    last = fir_lowpass(edge, rate / first, _LAST_STEP)
    before = fir_lowpass(edge, rate, first, width=rate / first - (2 + WIDEST) * edge)
    return FirFilter(last.taps, last.step, before)


_WEIGHTS = {
    1: np.array(
        [1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]
    ),
    2: np.array(
        [-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]
    ),
}

REACH = 4
"""Samples on either side of derivatives, and of values between samples: nine weigh a polynomial of degree 8."""

FAR_FROM_UNIT = 0.1
"""Largest deviation of a quaternion's length from 1 that rounding of a log explains; others are no quaternions."""


def derivative(values: Floats, rate: float, order: int = 1) -> Floats:
    """First or second derivative of values (N, …), which beyond their ends continue turned about them."""
    with extra("identify"):
        from scipy.ndimage import correlate1d

    widths = [(REACH, REACH)] + [(0, 0)] * (np.ndim(values) - 1)
    longer = np.pad(
        np.asarray(values, dtype=np.float64), widths, mode="reflect", reflect_type="odd"
    )
    return correlate1d(longer, _WEIGHTS[order] * rate**order, axis=0)[REACH:-REACH]


def derivatives(values: Floats, rate: float) -> tuple[Floats, Floats]:
    """First and second derivative of values (N, …)."""
    return derivative(values, rate), derivative(values, rate, 2)


def continuous(q: Floats) -> Floats:
    """Unit quaternions (N, 4) as w, x, y, z, whose sign does not jump."""
    length = np.linalg.norm(q, axis=1)
    wrong = np.flatnonzero(~(np.abs(length - 1) < FAR_FROM_UNIT))
    if len(wrong):
        worst = f"sample {wrong[0]} has a quaternion of length {length[wrong[0]]:.3g}"
        raise InputError(f"{worst}: expected unit quaternions (w, x, y, z)")
    unit = q / length[:, None]
    inner = np.einsum("ij,ij->i", unit, np.vstack([unit[:1], unit[:-1]]))
    signs = np.cumprod(np.where(inner < 0, -1.0, 1.0))
    return np.asarray(unit * signs[:, None], dtype=np.float64)


def multiply(a: Floats, b: Floats) -> Floats:
    """Products of quaternions, shape (N, 4); the rotation b comes first."""
    w, v = a[..., :1], a[..., 1:]
    u, t = b[..., :1], b[..., 1:]
    scalar = w * u - np.sum(v * t, axis=-1, keepdims=True)
    return np.concatenate([scalar, w * t + u * v + np.cross(v, t)], axis=-1)


INVERSE = np.array([1.0, -1.0, -1.0, -1.0])
"""Signs that make the inverse of a unit quaternion."""


def turned(q: Floats, vectors: Floats) -> Floats:
    """Vectors (N, 3) after the rotations of unit quaternions (N, 4)."""
    pure = np.column_stack([np.zeros(len(vectors)), vectors])
    return multiply(multiply(q, pure), q * INVERSE)[:, 1:]


def body_rates(q: Floats, qd: Floats, qdd: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit quaternions (N, 4), angular velocities and accelerations (N, 3), rad/s, rad/s², in the moved body's axes.

    ω = 2 q* ⊗ q̇ and its derivative, of which the parts along q, that is changes of length, count for nothing.
    """
    square = np.sum(q * q, axis=1, keepdims=True)
    conjugate = q * INVERSE
    first = multiply(conjugate, qd) / square
    second = multiply(conjugate, qdd) / square
    growth = 2 * first[:, :1]
    omega = 2 * first[:, 1:]
    return q / np.sqrt(square), omega, 2 * second[:, 1:] - growth * omega
