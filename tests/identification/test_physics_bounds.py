"""Bounds of fits: respected, and explained where they are wrong or contradict each other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import echelon as ec
from echelon.identification.fitting import _bounds
from echelon.identification.physics.fit import physical_fit
from echelon.robot.inertia import pseudo_inertia
from echelon.shared.errors import InputError
from support.physical_robots import bounds_of, model, observed, robot

PANDA = Path("examples/panda.yaml")


def test_bounds_are_respected() -> None:
    base, role = model("puma560")
    rng = np.random.default_rng(13)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng)
    names = [name for name, _ in role.bodies]
    given_bounds = {
        "bodies": {
            names[0]: {"mass": [2, 2]},
            names[1]: {"mass": [0.5, 0.6], "box": [[-0.1, -0.1, 0], [0.1, 0.1, 0]]},
            names[2]: {
                "ellipsoid": [[0.1, 0, 0], [0.05, 0.1, 0.02]],
                "mass": [0.3, np.inf],
            },
            names[3]: {"symmetry": ["xz", "yz"]},
            names[4]: {"symmetry": "z"},
            names[5]: {"extent": [[0, 0, 0.05], [0.1, 0.1, 0.1]]},
        },
        "parameters": {"XX4": [0.5, np.inf]},
        "total_mass": [4, 5],
    }
    bounds = bounds_of(given_bounds)
    fit = physical_fit(base, observation.combined(weights), bounds=bounds)
    bodies = role.blocks(fit.standard)
    mass, centre = bodies[:, 9], bodies[:, 6:9] / bodies[:, 9:]
    assert mass[0] == pytest.approx(2)
    assert 0.5 - 1e-9 <= mass[1] <= 0.6 + 1e-9
    assert (np.abs(centre[1]) <= np.array([0.1, 0.1, 1e-12]) + 1e-9).all()
    assert np.linalg.norm((centre[2] - [0.1, 0, 0]) / [0.05, 0.1, 0.02]) <= 1 + 1e-9
    assert np.allclose(bodies[3][[1, 2, 4, 6, 7]], 0, atol=1e-12)
    assert bodies[3, 0] >= 0.5 - 1e-9
    assert np.allclose(bodies[4][[1, 2, 4, 6, 7]], 0, atol=1e-12)
    assert bodies[4, 0] == pytest.approx(bodies[4, 3])
    inside = np.diag([-100.0, -100.0, -100.0, 1 - 0.25])
    inside[2, 3] = inside[3, 2] = 100 * 0.05
    assert np.trace(inside @ pseudo_inertia(bodies[5])) >= -1e-9
    assert 4 - 1e-9 <= mass.sum() <= 5 + 1e-9
    assert min(fit.margins.values()) > 0
    assert fit.misfit > fit.unconstrained_misfit
    loose = physical_fit(base, observation.combined(weights))
    assert loose.misfit < fit.misfit


def test_bounds_that_contradict_each_other() -> None:
    base, role = model("scara")
    rng = np.random.default_rng(14)
    observation, weights = observed(base, robot(role, rng), rng)
    names = [name for name, _ in role.bodies]
    for given_bounds in (
        {"bodies": {n: {"mass": [2, 3]} for n in names}, "total_mass": [0, 5]},
        {
            "bodies": {names[0]: {"box": [[0, 0, 0], [0, 0, 1]], "mass": [1, 1]}},
            "parameters": {"ZZ1": [-2, -1]},
        },
    ):
        with pytest.raises(InputError, match="contradict"):
            physical_fit(
                base, observation.combined(weights), bounds=bounds_of(given_bounds)
            )


@pytest.mark.parametrize(
    ("given_bounds", "message"),
    [
        ({"bodies": {"joint_1": {}}}, "no such body"),
        ({"bodies": {"j11": {}}}, "did you mean 'j1'"),
        ({"parameters": {"XX": [0, 1]}}, "did you mean 'XX"),
        ({"bodie": {}}, "did you mean 'bodies'"),
        ({"bodies": {"j1": {"mas": 1}}}, "did you mean 'mass'"),
        ({"bodies": {"j1": 3}}, "needs a mapping"),
        ({"bodies": {"j1": {"mass": [3, 2]}}}, "nothing is between"),
        ({"bodies": {"j1": {"mass": "heavy"}}}, "mass"),
        ({"bodies": {"j1": {"mass": [-2, -1]}}}, "nothing is between"),
        ({"bodies": {"j1": {"box": [[0, 0], [1, 1]]}}}, "box"),
        ({"bodies": {"j1": {"box": [[1, 0, 0], [0, 1, 1]]}}}, "first corner"),
        ({"bodies": {"j1": {"ellipsoid": [[0, 0, 0], [1, 0, 1]]}}}, "semi-axes"),
        ({"bodies": {"j1": {"symmetry": "w"}}}, "symmetry"),
        ({"total_mass": [1]}, "total_mass"),
        ({"parameters": {"M1": [True, 2]}}, "needs a number"),
    ],
)
def test_wrong_bounds_are_explained(
    tmp_path: Path, given_bounds: dict[str, Any], message: str
) -> None:
    base, _ = model("panda")
    file = tmp_path / "setup.json"
    file.write_text(
        json.dumps(
            {**yaml.safe_load(PANDA.read_text()), "identification": given_bounds}
        )
    )
    with pytest.raises(InputError, match=message) as error:
        _bounds(ec.load_setup(file), base)
    assert str(error.value).startswith(str(file))
