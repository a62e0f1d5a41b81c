"""Mechanisms with loops: whole states from independent ones, and what is asked of them."""
