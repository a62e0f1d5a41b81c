"""Rows: from prepared samples to regressor rows and R-factors, in one pass."""
