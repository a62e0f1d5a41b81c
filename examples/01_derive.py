"""Base parameters of an arm in closed form: how many there are, which sums they are, and which are seen alone.

python examples/01_derive.py
"""

from collections import Counter
from pathlib import Path

import echelon as ec

robot = ec.load(Path(__file__).with_name("panda.yaml"))
base = ec.base_parameters(robot)

print(repr(base))
for expression in base.expressions[:6]:
    print(f"  {expression}   [{expression.unit}]")
print("  ...")
for kind, count in Counter(kind.value for kind in base.classification.values()).items():
    print(f"{count} standard parameters are {kind}")
print(base.certificate)
