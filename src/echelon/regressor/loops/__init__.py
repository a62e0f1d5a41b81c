"""Closed loops: closure equations, closed poses and motions, in double precision and in ball arithmetic."""
