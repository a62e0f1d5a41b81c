"""How it is found: a start pose, the solver, several starts, and tightened bounds until all limits hold."""
