"""Validation: measured against predicted outputs, residuals, verdicts in words."""
