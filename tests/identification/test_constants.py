"""Constants of friction laws that rows are not linear in: planted ones lie in their intervals, or are open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import echelon as ec
from echelon.identification import constants
from echelon.shared import Floats

STRIBECK = "{type: coulomb, at: all}, {type: stribeck, at: all, velocity: c}"
TANH = '{parameter: Fw, unit: N·m, acts: [{at: j1, term: "tanh(qd/c)"}]}'
LUGRE = "{type: lugre, at: all, stiffness: s, velocity: c, ratio: r}"
VELOCITY, WIDTH, DRY, SLOW = 0.15, 0.2, 2.0, 1.0


def motion(t: Floats, sizes: Floats, rates: Floats) -> tuple[Floats, Floats, Floats]:
    angle = np.multiply.outer(t, rates)
    q = np.sin(angle) @ sizes
    return q, np.cos(angle) @ (sizes * rates), -np.sin(angle) @ (sizes * rates**2)


def log(seed: int, law: str, slow: float = SLOW) -> dict[str, Floats]:
    """Twenty seconds of a link with a mass and some law of friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / 200
    q, qd, qdd = motion(t, np.array([1.2, 0.3]), np.array([0.9, 2.3]))
    dry = {
        "stribeck": np.sign(qd) * (DRY + slow * np.exp(-((qd / VELOCITY) ** 2))),
        "tanh": DRY * np.tanh(qd / WIDTH),
    }[law]
    tau = 0.8 * qdd + 1.5 * qd + 3 * np.cos(q) + dry + 0.05 * rng.normal(size=len(t))
    return {"t": t, "q": q, "tau": tau}


def described(folder: Path, effects: str, symbols: str, more: str = "") -> Path:
    path = folder / "link.yaml"
    path.write_text(
        f"echelon: 1\nname: link\nsymbols: {symbols}\ngravity: [0, -9.81, 0]\n"
        "modified_dh: [{joint: revolute}]\n"
        f"effects: [{{type: viscous, at: all}}, {effects}]\n"
        f"log: {{time: t, position: {{j1: q}}, output: {{j1: tau}}}}\n{more}",
        encoding="utf-8",
    )
    return path


LAWS = {"stribeck": (STRIBECK, VELOCITY), "tanh": (TANH, WIDTH)}


def covered(folder: Path, law: str, count: int) -> list[bool]:
    effects, true = LAWS[law]
    path = described(folder, effects, "{c: {fit: [0.02, 1]}}")
    found = []
    for seed in range(count):
        result = ec.identify(path, log(seed, law))
        (constant,) = result.settings["constants"]
        low, high = constant["interval"]
        assert high < 1.3 * low
        found.append(low < true < high)
    return found


@pytest.mark.parametrize("law", LAWS)
def test_planted_constants_lie_in_their_intervals(law: str, tmp_path: Path) -> None:
    assert sum(covered(tmp_path, law, 3)) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_intervals_hold_as_often_as_they_say(law: str, tmp_path: Path) -> None:
    assert sum(covered(tmp_path, law, 60)) >= 53


def test_the_value_is_that_of_the_model(tmp_path: Path) -> None:
    path = described(tmp_path, STRIBECK, "{c: {fit: [0.02, 1]}}")
    result = ec.identify(path, log(0, "stribeck"))
    (constant,) = result.settings["constants"]
    symbol = result.base.mechanism.symbols["c"]
    assert symbol.value == constant["value"]
    assert symbol.fit is None
    (finding,) = [f for f in result.findings if f.kind == "constant"]
    line = f"symbols: {{c: {constant['value']}}}"
    assert finding.text.endswith(line)
    stated = ec.identify(
        described(tmp_path, STRIBECK, line.removeprefix("symbols: ")),
        log(0, "stribeck"),
    )
    np.testing.assert_allclose(
        stated.estimate.values, result.estimate.values, rtol=1e-9
    )
    ec.save_identification(result, tmp_path / "model.json")
    again = ec.load_identified(tmp_path / "model.json")
    assert again.plan.base.mechanism.symbols["c"].value == constant["value"]


def test_what_logs_do_not_determine_is_open(tmp_path: Path) -> None:
    path = described(tmp_path, STRIBECK, "{c: {fit: [0.02, 1]}}")
    result = ec.identify(path, log(0, "stribeck", slow=0.0))
    (constant,) = result.settings["constants"]
    assert constant["interval"] == (None, None)
    (finding,) = [f for f in result.findings if f.kind == "constant"]
    assert "these logs do not determine it" in finding.text


def test_a_range_that_ends_too_early_is_named(tmp_path: Path) -> None:
    path = described(tmp_path, STRIBECK, "{c: {fit: [0.02, 0.1]}}")
    result = ec.identify(path, log(0, "stribeck"))
    (finding,) = [f for f in result.findings if f.kind == "constant"]
    assert "to 0.1, where the range ends" in finding.text


def bristly_log(seed: int, stiffness: float, ratio: float) -> dict[str, Floats]:
    """A link with LuGre friction, by an integrator of differential equations."""
    t = np.arange(10_000) / 500
    sizes, rates = np.array([0.3, 0.01, 0.004]), np.array([0.7, 3.1, 7.3])

    def change(time: float, z: Floats) -> Floats:
        v = float(motion(np.array([time]), sizes, rates)[1][0])
        g = DRY * (1 + (ratio - 1) * np.exp(-((v / VELOCITY) ** 2)))
        return np.asarray(v - stiffness * DRY * abs(v) / g * z)

    z = solve_ivp(
        change, (0, t[-1]), [1 / stiffness], "LSODA", t, rtol=1e-8, atol=1e-10
    ).y[0]
    rate = np.array([change(*some) for some in zip(t, z, strict=True)])
    q, qd, qdd = motion(t, sizes, rates)
    force = stiffness * DRY * z + 5 * rate + 1.5 * qd
    noise = 0.03 * np.random.default_rng(seed).normal(size=len(t))
    return {"t": t, "q": q, "tau": 0.8 * qdd + 3 * np.cos(q) + force + noise}


def test_bristles_of_lugre_friction(tmp_path: Path) -> None:
    run = bristly_log(0, stiffness=1000.0, ratio=1.4)
    band = "preparation: {band: 20}\n"
    stated = described(tmp_path, LUGRE, f"{{s: 1000, c: {VELOCITY}, r: 1.4}}", band)
    estimate = ec.identify(stated, run).estimate
    values = dict(zip(estimate.parameters, estimate.values, strict=True))
    for name, true in (("ZZ1", 0.8), ("Fv1", 1.5), ("Fc1", DRY), ("Fb1", 5.0)):
        assert values[name] == pytest.approx(true, rel=0.05)
    symbols = f"{{s: {{fit: [100, 10000]}}, c: {VELOCITY}, r: {{fit: [1, 3]}}}}"
    fitted = described(tmp_path, LUGRE, symbols, band)
    found = {c["name"]: c for c in ec.identify(fitted, run).settings["constants"]}
    assert found["s"]["value"] == pytest.approx(1000, rel=0.02)
    assert found["r"]["value"] == pytest.approx(1.4, rel=0.02)
    for constant in found.values():
        low, high = constant["interval"]
        assert low < constant["value"] < high < 1.1 * low


def test_searches_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(constants, "_MOST_FITS", 10)
    path = described(tmp_path, STRIBECK, "{c: {fit: [0.02, 1]}}")
    with pytest.raises(ec.InputError, match="c were not found in 10 fits"):
        ec.identify(path, log(0, "stribeck"))


@pytest.mark.parametrize(
    ("symbols", "said"),
    [
        ("{c: {fit: [1, 0.1]}}", "a range goes from a number to a larger one"),
        ("{c: {fit: [0.1, 1], value: 0.3}}", "has a value or is fitted"),
    ],
)
def test_ranges_that_are_none(symbols: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ec.InputError, match=said):
        ec.load(described(tmp_path, STRIBECK, symbols))


def test_geometry_is_not_fitted(tmp_path: Path) -> None:
    path = described(tmp_path, STRIBECK, "{c: {fit: [0.1, 1]}}")
    text = path.read_text(encoding="utf-8").replace("revolute}", "revolute, a: c}")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ec.InputError, match="only constants of effects are fitted"):
        ec.load(path)


@pytest.mark.parametrize("vs", ["{fit: [-1, 1]}", "0"])
def test_velocities_of_laws_are_above_zero(vs: str) -> None:
    text = (
        f"{{echelon: 1, symbols: {{vs: {vs}}}, modified_dh: [{{joint: revolute}}],"
        " effects: [{type: stribeck, at: j1, velocity: vs}]}"
    )
    with pytest.raises(ec.InputError, match=r"symbols\.vs.*above zero"):
        ec.load(text)
