"""Observation matrices without the matrix: R-factors of stacked regressors, block by block."""
