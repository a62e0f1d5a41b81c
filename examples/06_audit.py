"""Base parameters that someone else claims, compared with the exact ones; each difference has a witness.

python examples/06_audit.py
"""

from pathlib import Path

import echelon as ec

robot = ec.load(Path(__file__).with_name("double_pendulum.yaml"))

right = ["ZZ1 + l1^2*M2", "MX1 + l1*M2", "MY1", "ZZ2", "MX2", "MY2"]
wrong = ["ZZ1 + l1*M2", *right[1:]]
print(ec.audit(robot, right).verdict.value)
print(ec.audit(robot, wrong))
