"""Oracles, builders and data that tests share."""
