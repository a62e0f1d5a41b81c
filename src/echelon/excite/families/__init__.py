"""Families of motions: linear combinations of functions of time, the same functions for every coordinate."""
