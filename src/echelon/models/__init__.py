"""Models that are not mechanisms: anything linear in its parameters."""
