"""The regressor of a mechanism, recorded as a program."""
