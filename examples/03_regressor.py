"""The base regressor X(q, q̇, q̈): batches in machine code, and formulas.

python examples/03_regressor.py
"""

from pathlib import Path

import numpy as np

import echelon as ec

base = ec.base_parameters(ec.load(Path(__file__).with_name("double_pendulum.yaml")))
q, qd, qdd = np.random.default_rng(0).normal(size=(3, 1000, 2))

reduced = base.regressor(q, qd, qdd)  # (sample, output, base parameter)
full = base.standard_regressor(q, qd, qdd)  # (sample, output, standard parameter)
print("shapes:", reduced.shape, full.shape)
print("X = X̄ B:", np.allclose(reduced @ base.B_float(), full))

formulas = base.symbolic_regressor()
print("X̄[0, 4] =", formulas.entries[0, 4])
