"""A joint that gives way, and friction with a Stribeck velocity, from a log with two encoders and known truth.

python examples/12_elastic_joint.py        needs  pip install "echelon-robotics[identify]"
"""

from pathlib import Path

import numpy as np

import echelon as ec

ratio, stiffness, damping, inertia, moment, rotor = 100, 3000.0, 5.0, 1.2, 2.5, 3e-4
viscous, dry, slow, velocity = 4e-3, 0.08, 0.05, 20.0

# a motion that repeats itself, so that derivatives and the damped spring are exact by its frequencies
t = np.arange(20_000) / 1000
omega = 2j * np.pi * np.fft.rfftfreq(len(t), 1e-3)


def of_frequencies(signal: np.ndarray, factor: np.ndarray) -> np.ndarray:
    return np.fft.irfft(np.fft.rfft(signal) * factor, len(t))


pace = 2 * np.pi * t / t[-1] * (1 - 1 / len(t))
q = 0.8 * np.sin(3 * pace) + 0.5 * np.cos(8 * pace)
load = inertia * of_frequencies(q, omega**2) + 9.81 * moment * np.cos(q)
theta = ratio * (q + of_frequencies(load, 1 / (stiffness + damping * omega)))
speed = of_frequencies(theta, omega)
friction = dry + slow * np.exp(-((speed / velocity) ** 2))
tau = rotor * of_frequencies(theta, omega**2) + viscous * speed + load / ratio
tau += np.sign(speed) * friction

rng = np.random.default_rng(1)
noise = {"q": 2e-6, "theta": 1e-4, "tau": 0.01}
log = {"t": t, "q": q, "theta": theta, "tau": tau}
log |= {
    name: log[name] + size * rng.normal(size=len(t)) for name, size in noise.items()
}
result = ec.identify(Path(__file__).parent / "logs" / "elastic_joint.yaml", log)

true = {"ZZ1": inertia, "MX1": moment, "ZZ_m1": rotor, "Fv1": viscous, "Fc1": dry}
true |= {"Fs1": slow, "Ks1": stiffness, "Ds1": damping}
estimate = result.estimate
for name, value, std in zip(
    estimate.parameters, estimate.values, estimate.std, strict=True
):
    print(f"{name:>5} = {value:10.5g} ± {std:8.2g}   true {true.get(name, 0):g}")
constant = result.settings["constants"][0]
low, high = constant["interval"]
print(f"   vs = {constant['value']:.3g} in {low:.3g} … {high:.3g}   true {velocity:g}")
print(
    "stiffness within four standard deviations:",
    abs(estimate.values[estimate.parameters.index("Ks1")] - stiffness)
    < 4 * estimate.std[estimate.parameters.index("Ks1")],
)
