"""Saved base models: the JSON schema, writing, reading, and checking again."""
