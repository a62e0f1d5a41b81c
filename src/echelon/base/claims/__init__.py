"""Sets of base parameters claimed by others: reading them, and saying exactly what is right and wrong about them."""
