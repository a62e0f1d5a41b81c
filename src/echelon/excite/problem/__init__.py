"""The problem of a design: the task, families of motions, limits, information, and the optimisation problem."""
