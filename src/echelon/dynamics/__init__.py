"""Functions of robots: regressors, inverse dynamics and its parts, their derivatives, as recorded programs."""
