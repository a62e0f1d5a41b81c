"""Mutation testing of the core: small faults, one after another, that the tests must notice.

``make mutate``, or ``python -m mutation`` in the folder ``tests``, plants each fault in a copy of the source and runs
the tests that should fall.
"""
