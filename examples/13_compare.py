"""Two URDFs of one robot disagree: what nobody can see, what matters, and by how much torque.

python examples/13_compare.py
"""

from pathlib import Path

import echelon as ec

first = Path(__file__).with_name("so101.urdf").read_text(encoding="utf-8")
limits = {"velocity": 3, "acceleration": 20}

heavier = first.replace('<mass value="0.087"/>', '<mass value="0.095"/>')
found = ec.compare(first, heavier, limits=limits)
print(found)
print(
    f"gripper 8 g heavier: {found.verdict}, {len(found.base)} of {found.rank} base parameters"
)

moved = Path(__file__).parents[1] / "docs/examples/so101_cad.urdf"
found = ec.compare(heavier, moved, limits=limits)
print(
    f"20 g moved over the elbow as well: {found.verdict}; cancelled: {found.cancelled}"
)
