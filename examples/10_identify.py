"""From a log to a validated model: here a log that is made from known parameters, with noise.

python examples/10_identify.py        needs  pip install "echelon-robotics[identify]"
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import echelon as ec

setup = ec.load_setup(Path(__file__).with_name("double_pendulum.yaml"))
base = ec.base_parameters(setup.mechanism)
true = np.array([0.31, 0.9, 0.01, 0.07, 0.25, -0.02])

# two sines per joint, and the torques of the true parameters
t = np.arange(4000) / 500
size, rate = np.array([[0.9, 0.4], [0.5, 0.7]]), np.array([[2.1, 5.3], [3.4, 7.9]])
phase = t[:, None, None] * rate
q = (size * np.sin(phase)).sum(axis=2)
qd = (size * rate * np.cos(phase)).sum(axis=2)
qdd = (-size * rate**2 * np.sin(phase)).sum(axis=2)
tau = base.predict(q, qd, qdd, true) + 0.05 * np.random.default_rng(1).normal(
    size=(len(t), 2)
)

with TemporaryDirectory() as folder:
    log = Path(folder) / "run.csv"
    columns = np.column_stack([t, q, tau])
    np.savetxt(log, columns, delimiter=",", header="t,q1,q2,tau1,tau2", comments="")
    result = ec.identify(setup, [log])

low, high = result.estimate.interval(0.95).T
for name, value, a, b, truth in zip(
    base.pivots, result.estimate.values, low, high, true, strict=True
):
    print(f"{name:>4} = {value:8.4f}  in {a:8.4f} … {b:8.4f}   true {truth:8.4f}")
print(result.verdict)
