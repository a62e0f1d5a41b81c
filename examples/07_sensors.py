"""What subsets of sensors see, and the smallest subset that sees everything.

python examples/07_sensors.py
"""

from pathlib import Path

import echelon as ec

robot = ec.load(Path(__file__).with_name("furuta.yaml"))
report = ec.sensor_report(robot, 2)

for sensors, rank in report.ranks.items():
    print(f"{' + '.join(sensors)}: {rank} of {report.rank}")
print("sufficient:", ", ".join(report.smallest))
