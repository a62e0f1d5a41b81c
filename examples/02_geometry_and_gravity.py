"""The number of base parameters depends on gravity and geometry; a rank is found without closed forms in milliseconds.

python examples/02_geometry_and_gravity.py
"""

from pathlib import Path

import echelon as ec

FILE = Path(__file__).with_name("double_pendulum.yaml")

for gravity in ("file", "none", "generic"):
    robot = ec.load(FILE, gravity=gravity)
    print(f"gravity {gravity}: {ec.base_structure(robot).rank} base parameters")
print(
    f"floating base: {ec.base_structure(ec.load(FILE, floating=True)).rank} base parameters"
)

found = ec.special_geometry(ec.load(FILE))
print(f"general values of the symbols: {found.rank}")
for case in found.cases:
    print(f"  {case.condition}: {case.rank}")
