"""Settings for the whole test run."""

from __future__ import annotations

from hypothesis import settings

# The same examples on every run, and no time limit per example: the first one pays for imports and caches.
settings.register_profile("echelon", deadline=None, derandomize=True)
settings.load_profile("echelon")
