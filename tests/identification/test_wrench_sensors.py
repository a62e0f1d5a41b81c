"""Force/torque sensors in the hand of an arm that MuJoCo moves: unknown zeros beside the load, and their intervals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.identification.logs.columns.column_map import Channel
from echelon.identification.setup.setup import Setup
from support.simulated_systems import SYSTEMS, motion_of

COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")
ZEROS = np.array([2.0, -3.0, 5.0, 0.1, -0.05, 0.02])
NOISE = np.array([0.3, 0.3, 0.3, 0.01, 0.01, 0.01])
ARM = SYSTEMS["wrist sensor"]
SEEDS = 50


def sensor(folder: Path, **changes: Any) -> Setup:
    """The arm with the sensor in its hand alone."""
    (_, wrench) = ARM.setup["outputs"]
    columns = {f"ft.{c}": c for c in COMPONENTS}
    log = {"time": "t", "position": "q{n}", "output": columns}
    setup = {"outputs": [wrench], "log": log}
    return (
        replace(ARM, setup=setup).load(folder, **changes).with_settings(physical=False)
    )


@cache
def truth() -> dict[str, float]:
    """Parameters of the load in the hand."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        base, standard = ARM.truth(Path(folder))
    return dict(zip(base.parameters, standard.tolist(), strict=True))


def run(seed: int, zeros: np.ndarray = ZEROS, sign: float = 1.0) -> dict[str, Any]:
    """A log of the sensor with noise and zeros."""
    motion = motion_of(ARM)
    rng = np.random.default_rng(seed)
    y = sign * motion.y[:, -6:] + zeros + NOISE * rng.normal(size=(len(motion.q), 6))
    positions = {f"q{k}": q for k, q in enumerate(motion.q.T, start=1)}
    return {"t": motion.time, **positions, **dict(zip(COMPONENTS, y.T, strict=True))}


def expected(result: ec.Identification, zeros: np.ndarray = ZEROS) -> np.ndarray:
    """True values of the base parameters, each of which is one parameter."""
    known = truth() | {f"Fo_ft_{c}": z for c, z in zip(COMPONENTS, zeros, strict=True)}
    assert [str(e) for e in result.base.expressions] == list(result.base.pivots)
    return np.array([known[name] for name in result.base.pivots])


def test_zeros_are_unknown_unless_a_set_up_says_otherwise(tmp_path: Path) -> None:
    result = ec.identify(sensor(tmp_path), run(1))
    assert result.base.rank == 16
    assert any("an unknown zero" in str(finding) for finding in result.findings)
    errors = (result.estimate.values - expected(result)) / result.estimate.std
    assert np.abs(errors).max() < 4.5
    assert not result.reasons


def test_a_set_up_without_them_is_told_of_them(tmp_path: Path) -> None:
    """Without zeros the gains of its components run away: these are tested no more, and the fit is delivered."""
    result = ec.identify(sensor(tmp_path, effects="none"), run(1))
    (found,) = (f for f in result.findings if f.kind == "missing effect")
    places = ", ".join(f"ft.{component}" for component in COMPONENTS)
    assert f"add {{type: offset, at: [{places}]}} to 'effects'" in found.text


def test_a_drift_with_temperature_is_an_effect_of_the_output(tmp_path: Path) -> None:
    log = run(2)
    warmth = 5 * np.sin(0.7 * log["t"]) + log["t"] / 4
    log = {**log, "fz": log["fz"] + 0.4 * warmth, "warmth": warmth}
    drift = {"parameter": "drift", "unit": "N/K"}
    drift["acts"] = [{"at": "ft.fz", "term": "i[j4]"}]
    setup = sensor(tmp_path, effects=["usual", drift])
    columns = replace(setup.columns[0], inputs={"j4": Channel("warmth")})
    result = ec.identify(replace(setup, columns=(columns,)), log)
    place = result.estimate.parameters.index("drift")
    error = result.estimate.values[place] - 0.4
    assert abs(error) < 4 * result.estimate.std[place]


@pytest.mark.slow
def test_intervals_cover_loads_and_zeros(tmp_path: Path) -> None:
    setup = sensor(tmp_path)
    inside = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(1000 + seed)
        zeros = ZEROS * rng.uniform(-1, 1, 6)
        result = ec.identify(setup, run(seed, zeros))
        low, high = result.estimate.interval(0.95).T
        true = expected(result, zeros)
        inside.append((low <= true) & (true <= high))
    rates = np.mean(inside, axis=0)
    assert np.mean(inside) > 0.92, rates
    assert rates.min() > 0.8, rates
