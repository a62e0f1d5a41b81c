"""Identified models as documents: the JSON schema, writing and reading."""
