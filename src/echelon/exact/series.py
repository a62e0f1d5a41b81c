"""Truncated power series over GF(p): arrays of residues whose last axis holds the coefficients of powers of t."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.arrays import Flags
from echelon.exact.field import PrimeField, Residues, solve_batched

_BLOCK = 1024  # series that are multiplied together, so that they stay in the cache
_SMALL = 8  # unknowns that are as fast to solve for together as one after the other
_UNREDUCED = 3  # products of residues below 2^31 that may be added to one and a residue: four of them fit into 64 bits


def constant(value: Residues, order: int) -> Residues:
    """Constants as series of this many coefficients."""
    series = np.zeros((*value.shape, order), dtype=np.int64)
    series[..., 0] = value
    return series


def product(a: Residues, b: Residues, field: PrimeField) -> Residues:
    """Elementwise product of series, truncated to their length; leading axes broadcast.  Shapes: a, b (..., order)."""
    order = a.shape[-1]
    if order == 1:
        return np.asarray(a * b % field.p)
    shape = np.broadcast_shapes(a.shape, b.shape)
    left, right = (np.broadcast_to(x, shape).reshape(-1, order) for x in (a, b))
    result = np.empty(left.shape, dtype=np.int64)
    for start in range(0, len(left), _BLOCK):
        block = slice(start, start + _BLOCK)
        result[block] = _convolved(left[block], right[block], field.p).T
    return result.reshape(shape)


def _convolved(a: Residues, b: Residues, p: int) -> npt.NDArray[np.uint64]:
    """Products of a few series, (order, series): coefficients come first, so that all loops are over whole rows."""
    prime = np.uint64(p)
    left, right = (np.ascontiguousarray(x.T).astype(np.uint64) for x in (a, b))
    total: npt.NDArray[np.uint64] = left[0] * right
    for j in range(1, len(left)):
        total[j:] += left[j] * right[:-j]
        if j % _UNREDUCED == 0:
            total %= prime
    total %= prime
    return total


def inverse(a: Residues, field: PrimeField) -> Residues:
    """Elementwise 1/a by Newton's iteration."""
    order, known = a.shape[-1], 1
    result = field.invert_array(a[..., :1])
    while known < order:
        known = min(2 * known, order)
        guess = padded(result, known)
        error = product(a[..., :known], guess, field)
        error[..., 0] -= 2
        result = product(guess, -error % field.p, field)
    return result


def derivative(a: Residues, field: PrimeField) -> Residues:
    """d/dt; the last coefficient, which is not known, is zero."""
    result = np.zeros_like(a)
    result[..., :-1] = a[..., 1:] * np.arange(1, a.shape[-1]) % field.p
    return result


def integral(a: Residues, field: PrimeField) -> Residues:
    """∫ a dt without a constant term."""
    result = np.zeros_like(a)
    counts = np.array([field.invert(k) for k in range(1, a.shape[-1])], dtype=np.int64)
    result[..., 1:] = a[..., :-1] * counts % field.p
    return result


def matrix_product(a: Residues, b: Residues, field: PrimeField) -> Residues:
    """Products of matrices of series: (..., n, m, order) and (..., m, k, order) give (..., n, k, order)."""
    p, (rows, inner, order), columns = field.p, a.shape[-3:], b.shape[-2]
    shape = (*np.broadcast_shapes(a.shape[:-3], b.shape[:-3]), rows, columns, order)
    result = np.empty(shape, dtype=np.int64)
    # the sum of a_j b_(t-j) is one product of a_0 … a_t side by side and b_t … b_0 one below the other; with halves of
    # 16 bits its sums are exact in double precision, and BLAS can do them
    left = np.moveaxis(a, -1, -2).reshape(*a.shape[:-3], rows, order * inner)
    right = np.moveaxis(b[..., ::-1], -1, -3).reshape(*b.shape[:-3], order * inner, columns)
    left = np.concatenate([left >> 16, left & 0xFFFF], axis=-2).astype(np.float64)
    right = np.concatenate([right >> 16, right & 0xFFFF], axis=-1).astype(np.float64)
    for t in range(order):
        summed = left[..., : (t + 1) * inner] @ right[..., (order - 1 - t) * inner :, :]
        parts = summed.astype(np.int64).reshape(*shape[:-3], 2, rows, 2, columns) % p
        high, low = parts[..., 0, :, 0, :], parts[..., 1, :, 1, :]
        middle = parts[..., 0, :, 1, :] + parts[..., 1, :, 0, :]
        result[..., t] = ((high * 65536 + middle) % p * 65536 + low) % p
    return result


Inverses = dict[tuple[tuple[int, ...], tuple[int, ...]], Residues]
"""Inverses of the blocks of a matrix of series, by their rows and columns."""


def solve(a: Residues, right: Residues, field: PrimeField, known: Inverses | None = None) -> tuple[Residues, Inverses]:
    """x with a x = b, and the inverses of the blocks on the diagonal, continued from those known to fewer terms."""
    # loops in series make matrices that are triangular but for small blocks, so their equations are solved one after
    # the other.  Shapes: a (batch, n, n, order), b (batch, n, k, order) of the same order or a lower one
    samples, order = range(len(a)), right.shape[-1]
    result, inverses, pattern = np.zeros_like(right), Inverses(), np.asarray(a.any(axis=(0, -1)))
    solved: list[int] = []
    for rows, columns in _triangular(a, pattern, field):
        left = right[:, rows]
        earlier = [c for c in solved if pattern[list(rows), c].any()]
        if earlier:
            driven = matrix_product(a[np.ix_(samples, rows, earlier)][..., :order], result[:, earlier], field)
            left = (left - driven) % field.p
        inverse = _inverted(a[np.ix_(samples, rows, columns)], field, (known or {}).get((rows, columns)))
        inverses[rows, columns] = inverse
        result[:, columns] = matrix_product(inverse[..., :order], left, field)
        solved += columns
    return result, inverses


def _triangular(a: Residues, pattern: Flags, field: PrimeField) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Rows and columns of blocks, in an order in which those above the diagonal vanish."""
    # what determines an unknown is read from the inverse of random combinations of the coefficients
    size, rng = len(pattern), np.random.default_rng(0)
    mixed = (a[0] * field.draw(rng, (a.shape[-1],)) % field.p).sum(axis=-1) % field.p
    determines = solve_batched(mixed[None], np.eye(size, dtype=np.int64)[None], field)[0] != 0
    order = sorted(range(size), key=lambda column: (determines[column].sum(), determines[column].tolist()))
    blocks, rows, columns, left = [], list[int](), list[int](), np.ones(size, dtype=bool)
    for place, column in enumerate(order):
        rows, columns = [*rows, *np.flatnonzero(determines[column] & left).tolist()], [*columns, column]
        left[rows] = False
        if len(rows) == len(columns) and (len(rows) >= _SMALL or not left.any()):
            if pattern[rows][:, order[place + 1 :]].any():
                break
            blocks.append((tuple(rows), tuple(columns)))
            rows, columns = [], []
    return blocks if not rows else [(tuple(range(size)), tuple(range(size)))]


def _inverted(a: Residues, field: PrimeField, start: Residues | None) -> Residues:
    order, size = a.shape[-1], a.shape[-2]
    if start is None:
        unit = np.broadcast_to(np.eye(size, dtype=np.int64), (len(a), size, size))
        start = solve_batched(a[..., 0], unit, field)[..., None]
    result, known = start, start.shape[-1]
    while known < order:
        known = min(2 * known, order)
        guess = padded(result, known)
        error = -matrix_product(a[..., :known], guess, field)
        for k in range(size):
            error[..., k, k, 0] += 2
        result = matrix_product(guess, error % field.p, field)
    return result


def padded(a: Residues, order: int) -> Residues:
    """Series with zeros for more coefficients."""
    result = np.zeros((*a.shape[:-1], order), dtype=np.int64)
    result[..., : a.shape[-1]] = a
    return result
