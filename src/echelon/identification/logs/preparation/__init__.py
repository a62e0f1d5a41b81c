"""From a recording to samples for least squares: segments, filters, derivatives, and their settings."""
