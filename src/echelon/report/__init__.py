"""Reports: one self-contained HTML page about an identification."""
