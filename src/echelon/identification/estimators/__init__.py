"""Estimators: values, covariances and diagnostics from R-factors or rows."""
