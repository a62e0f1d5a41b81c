"""Exact algebra: numbers, polynomials, finite fields, elimination, interpolation.  Knows nothing about robots."""
