"""Times of physically consistent fits and of proofs: an arm, and a humanoid with simulated noise.

python benchmarks/physics.py
"""

from __future__ import annotations

import sysconfig
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

import echelon as ec
from echelon.base.model import BaseModel
from echelon.compute.observe.observation import Observation
from echelon.identification.physics.bounds import roles
from echelon.identification.physics.feasibility import feasibility, physical_lift
from echelon.identification.physics.fit import physical_fit
from echelon.identification.physics.prior_information import reference

ROBOTS = (
    Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
)
SAMPLES, STRETCHES, NOISE = 4000, 4, 0.05


def states(base: BaseModel, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Random states, with unit quaternions."""
    mechanism = base.mechanism
    q = rng.uniform(-2, 2, (SAMPLES, len(mechanism.positions)))
    places = {name: k for k, name in enumerate(mechanism.positions)}
    for motion in mechanism.motions:
        if len(motion.positions) == 4:
            columns = [places[name] for name in motion.positions]
            q[:, columns] /= np.linalg.norm(q[:, columns], axis=1, keepdims=True)
    qd, qdd = (
        rng.uniform(-3, 3, (SAMPLES, len(mechanism.velocities))) for _ in range(2)
    )
    return {"q": q, "qd": qd, "qdd": qdd}


def measured(
    base: BaseModel, truth: np.ndarray, rng: np.random.Generator
) -> tuple[list[Observation], np.ndarray]:
    """Observations of stretches of a log with noise, and the weights of the outputs."""
    log = states(base, rng)
    y = base.predict(log["q"], log["qd"], log["qdd"], truth)
    sigma = NOISE * np.maximum(np.abs(y).mean(axis=0), 1e-3)
    log["y"] = y + sigma * rng.standard_normal(y.shape)
    cuts = np.array_split(np.arange(SAMPLES), STRETCHES)
    return [
        base.accumulate({name: values[cut] for name, values in log.items()})
        for cut in cuts
    ], 1 / sigma


def timed(text: str, call: Callable[[], object]) -> object:
    """The result of a call; its time is printed."""
    start = perf_counter()
    result = call()
    print(f"  {text:<52}{perf_counter() - start:8.3f} s")
    return result


def run(name: str, base: BaseModel, stated: np.ndarray) -> None:
    """All times of one robot."""
    rng = np.random.default_rng(2015)
    prior = reference(roles(base.mechanism), stated)
    print(
        f"{name}: {len(prior.bodies)} bodies, {base.rank} of {len(base.parameters)} parameters"
    )
    truth = stated.copy()
    for start, body in zip(roles(base.mechanism).starts, prior.bodies, strict=True):
        truth[start : start + 10] = body * rng.uniform(0.7, 1.4)
    truth = np.nan_to_num(truth, nan=0.1)
    pieces, weights = timed(
        "simulated log, observation matrices",
        lambda: measured(base, base.values(truth), rng),
    )
    whole = sum(pieces[1:], pieces[0]).combined(weights)
    timed("fit without a prior", lambda: physical_fit(base, whole))
    timed(
        "fit with a prior",
        lambda: physical_fit(base, whole, prior=stated, prior_weight=1.0),
    )
    fit = timed(
        f"fit, weight of the prior from {STRETCHES} stretches",
        lambda: physical_fit(
            base,
            whole,
            prior=stated,
            prior_weight="auto",
            pieces=pieces,
            weights=weights,
        ),
    )
    print(
        f"    weight {fit.prior_weight:g}, misfit {fit.misfit - fit.least_misfit:.1f} above the least one"
    )
    timed("lift to standard parameters", lambda: physical_lift(base, fit.base))
    print(
        "    "
        + timed(
            "a robot has these values", lambda: feasibility(base, fit.base)
        ).evidence
    )
    wrong = fit.base.copy()
    wrong[
        next(
            k
            for k, p in enumerate(base.matrix.pivots)
            if base.mechanism.columns[p].kind == 5
        )
    ] *= -2
    print(
        "    "
        + timed("no robot has other values", lambda: feasibility(base, wrong)).evidence
    )


def main() -> None:
    """An arm of seven joints and a humanoid of 29."""
    panda = ec.base_parameters(ec.load(ROBOTS / "panda_description/urdf/panda.urdf"))
    run("panda with fingers", panda, panda.standard_values())
    humanoid = ec.base_parameters(
        ec.load(ROBOTS / "g1_description/urdf/g1_29dof_rev_1_0.urdf", floating=True)
    )
    run(
        "g1, 29 joints, floating",
        humanoid,
        np.array(humanoid.mechanism.standard_values(), dtype=float),
    )


if __name__ == "__main__":
    main()
