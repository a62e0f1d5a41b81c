"""Drive gains: motor constants from runs with a known load."""
