"""What is asked for: the task, families of motions, limits, information, and the optimisation problem."""
