"""The published schema of descriptions."""
