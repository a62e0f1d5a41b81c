"""Values of base parameters, and the standard parameters nearest to a guess that have these values.

python examples/04_values_and_lift.py
"""

from pathlib import Path

import numpy as np

import echelon as ec

base = ec.base_parameters(ec.load(Path(__file__).with_name("double_pendulum.yaml")))
standard = np.random.default_rng(1).uniform(0.1, 1.0, len(base.parameters))

values = base.values(standard)
for name, value, unit in zip(base.pivots, values, base.units, strict=True):
    print(f"{name:>4} = {value:.4f} {unit}")

guess = np.ones_like(standard)
lifted = base.lift(values, prior=guess)
print("same base parameters:", np.allclose(base.values(lifted), values))
print(f"distance from the guess: {np.linalg.norm(lifted - guess):.3f}")
