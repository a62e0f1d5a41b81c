"""Closed loops: closure equations, closed poses, curves and motions, modulo primes and in double precision."""
