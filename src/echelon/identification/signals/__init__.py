"""Signals: filters, derivatives, spectra and clocks of sampled data.  Knows no robots."""
