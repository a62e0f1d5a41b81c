"""Any model that is linear in its parameters has a minimal set, also outside of robotics.

python examples/09_linear_model.py
"""

from pathlib import Path

import echelon as ec

model = ec.load_linear(Path(__file__).parent / "linear" / "heat_capacity.yaml")
base = ec.base_parameters(model)

print(repr(base))
for expression in base.expressions:
    print(f"  {expression}")
