"""Truncated power series over GF(p): arrays of residues whose last axis holds the coefficients of powers of t."""

from __future__ import annotations

import numpy as np

from echelon.exact.elimination import solve_batched
from echelon.exact.field import PrimeField, Residues


def constant(value: Residues, order: int) -> Residues:
    """Constants as series of this many coefficients."""
    series = np.zeros((*value.shape, order), dtype=np.int64)
    series[..., 0] = value
    return series


def product(a: Residues, b: Residues, field: PrimeField) -> Residues:
    """Elementwise product of series, truncated to their length; leading axes broadcast.  Shapes: a, b (..., order)."""
    p, order = field.p, a.shape[-1]
    result = np.zeros(np.broadcast_shapes(a.shape, b.shape), dtype=np.int64)
    for j in range(order):
        # sums of up to 2^32 residues fit into 63 bits
        result[..., j:] += a[..., j, None] * b[..., : order - j] % p
    return result % p


def inverse(a: Residues, field: PrimeField) -> Residues:
    """Elementwise 1/a by Newton's iteration."""
    order, known = a.shape[-1], 1
    result = field.invert_array(a[..., :1])
    while known < order:
        known = min(2 * known, order)
        guess = _padded(result, known)
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
    """Products of matrices of series."""
    # shapes: a (..., n, m, order); b (..., m, k, order); returns (..., n, k, order)
    p, rows, columns, order = field.p, a.shape[-3], b.shape[-2], a.shape[-1]
    shape = (*np.broadcast_shapes(a.shape[:-3], b.shape[:-3]), rows, columns, order)
    result = np.zeros(shape, dtype=np.int64)
    # halves of 16 bits, so that sums of products of them are exact in double precision and BLAS can do them
    right = b.reshape(*b.shape[:-2], columns * order)
    halves = np.concatenate([right >> 16, right & 0xFFFF], axis=-1).astype(np.float64)
    for j in range(order):
        left = np.concatenate([a[..., j] >> 16, a[..., j] & 0xFFFF], axis=-2).astype(np.float64)
        parts = (left @ halves).astype(np.int64).reshape(*shape[:-3], 2, rows, 2, columns, order) % p
        high, low = parts[..., 0, :, 0, :, :], parts[..., 1, :, 1, :, :]
        middle = parts[..., 0, :, 1, :, :] + parts[..., 1, :, 0, :, :]
        total = ((high * 65536 + middle) % p * 65536 + low) % p
        result[..., j:] += total[..., : order - j]
    return result % p


def matrix_inverse(a: Residues, field: PrimeField, start: Residues | None = None) -> Residues:
    """Inverses of square matrices of series by Newton's iteration."""
    # shapes: a (batch, n, n, order); start (batch, n, n, known)
    order, size = a.shape[-1], a.shape[-2]
    if start is None:
        unit = np.broadcast_to(np.eye(size, dtype=np.int64), (len(a), size, size))
        start = solve_batched(a[..., 0], unit, field)[..., None]
    result, known = start, start.shape[-1]
    while known < order:
        known = min(2 * known, order)
        guess = _padded(result, known)
        error = -matrix_product(a[..., :known], guess, field)
        for k in range(size):
            error[..., k, k, 0] += 2
        result = matrix_product(guess, error % field.p, field)
    return result


def _padded(a: Residues, order: int) -> Residues:
    result = np.zeros((*a.shape[:-1], order), dtype=np.int64)
    result[..., : a.shape[-1]] = a
    return result
