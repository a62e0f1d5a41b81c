"""Generated functions that take the geometry as an argument."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import echelon as ec
from echelon.cli.commands import app
from echelon.codegen.source import generate
from echelon.errors import InputError
from support import generated_code as generated
from support.paths import ROOT


def base(name: str) -> ec.BaseModel:
    return ec.base_parameters(ec.load(ROOT / f"examples/{name}.yaml"))


def cases() -> list[object]:
    quick = [(target, "double_pendulum") for target in generated.RUNNERS]
    return [*quick, ("c", "panda"), ("python", "rx90")]


@pytest.mark.parametrize(("target", "name"), cases())
def test_two_geometries_of_one_build(target: str, name: str, tmp_path: Path) -> None:
    model = base(name)
    chosen = ["regressor", "inverse_dynamics"] if target != "jax" else ["inverse_dynamics"]
    source = generate(model, target, chosen, name="arm", keep_symbols=True)
    for file, text in source.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    call = generated.RUNNERS[target](generated.Build(tmp_path, "arm", source.functions, "double"))
    rng = np.random.default_rng(5)
    labels = next(a.labels for a in source.functions[0].arguments if a.name == "symbols")
    assert set(labels) <= set(model.mechanism.symbols)
    q, qd, qdd = rng.uniform(-2, 2, (3, 7, len(model.mechanism.velocities)))
    zeta = rng.normal(size=model.rank)
    for lengths in rng.uniform(0.2, 0.9, (2, len(labels))):
        symbols = dict(zip(labels, map(float, lengths), strict=True))
        wanted = {
            "regressor": model.regressor(q, qd, qdd, symbols),
            "inverse_dynamics": model.predict(q, qd, qdd, zeta, symbols),
        }
        for function in source.functions:
            assert next(a.labels for a in function.arguments if a.name == "symbols") == labels
            values = {"q": q, "qd": qd, "qdd": qdd, "parameters": zeta, "symbols": lengths}
            found = call(function, values)
            np.testing.assert_allclose(found, wanted[function.name], atol=1e-11)


def test_only_some() -> None:
    model = base("panda")
    source = generate(model, "c", ["regressor"], keep_symbols=["a7", "d3"])
    argument = next(a for a in source.functions[0].arguments if a.name == "symbols")
    assert set(argument.labels) == {"a7", "d3"}
    header = source["panda.h"]
    assert "a7 [SI], 0.088 in the robot's file" in header
    assert "a7 = " not in header.partition("Put in as constants:")[2]
    assert "d5 = 0.384" in header.partition("Put in as constants:")[2]


def test_refusals() -> None:
    model = base("double_pendulum")
    with pytest.raises(InputError, match="no symbol 'l9' to keep \\(valid: g, l1\\)"):
        generate(model, "c", ["gravity"], keep_symbols=["l9"])
    with pytest.raises(InputError, match="'l1' is kept as an argument"):
        generate(model, "c", ["gravity"], keep_symbols=True, symbols={"l1": 1.0})
    with pytest.raises(InputError, match="belong to one geometry"):
        generate(model, "c", ["gravity"], keep_symbols=True, parameters=dict.fromkeys(model.pivots, 1.0))


def test_command(tmp_path: Path) -> None:
    robot = str(ROOT / "examples/double_pendulum.yaml")
    arguments = ["generate", robot, "-o", str(tmp_path), "--function", "regressor", "--json", "--keep-symbols", "all"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0
    assert json.loads(done.stdout)["functions"]["regressor"]["arguments"]["symbols"] == 2
