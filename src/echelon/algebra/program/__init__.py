"""Straight-line programs: recording, evaluation, sampling."""
