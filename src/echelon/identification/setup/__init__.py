"""Set-ups: a robot, what its logs mean, and what is to be done with them."""
