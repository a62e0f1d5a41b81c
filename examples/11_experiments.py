"""Several experiments with one robot: what each adds, the fewest that show all, and feet whose forces nobody measures.

python examples/11_experiments.py
"""

from pathlib import Path

import echelon as ec

robot = ec.load(Path(__file__).with_name("panda.yaml"))
table = ec.Experiment(robot, "table")
wall = ec.Experiment(robot, "wall", gravity=(9.81, 0, 0))

found = ec.plan([table, wall])
for name, rank in found.added:
    print(f"with {name}: {rank}")
print(f"the {found.smallest[0]} alone shows all: {found.rank}")

won = set(ec.base_parameters([table, wall]).pivots) - set(
    ec.base_parameters(table).pivots
)
print("the wall wins", ", ".join(sorted(won)))

# a load and the link that carries it are told apart by one run without the load
loaded = ec.Experiment(robot, "loaded", payloads={"tool": "j7"})
print("with a load:", ec.base_parameters([table, loaded]).rank)

# how many harmonics of a Fourier series show all, whatever their coefficients
print("harmonics:", len(ec.motion_ranks(robot)))
