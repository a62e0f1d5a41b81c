"""How far the parts of a robot stay from each other and from what is around it."""
