"""Identification: estimators, what data can see, physical consistency, validation."""
