"""Inertia of one body in other forms: about other frames, as matrices, and in other programs' conventions."""
