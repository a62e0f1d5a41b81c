"""Effects that a set-up leaves out, planted in simulated arms: named with the words that add them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification.logs.finding import Finding
from support.selection import one_in
from support.simulated_models import Drive, Part
from support.simulated_motions import RATE, fourier
from support.simulated_robots import System
from support.simulated_systems import SHORT_ARM, SYSTEMS, motion_of

ARM = """{echelon: 1, name: arm, gravity: [0, 0, -9.81], modified_dh: [{joint: revolute},
  {joint: revolute, alpha: pi/2, a: 0.1}, {joint: revolute, a: 0.5}]"""
BODIES = """4 0 0 3 0 2 1 0.5 0.2 9   0.4 0 0 1.2 0 1.1 1.5 0.1 0.3 5   0.1 0 0 0.3 0 0.3 0.5 0 0.1 2"""
VALUES = {"Fv": 2.0, "Fc": 1.5, "Fo": 0.3, "Ia": 0.3}


def missing(
    planted: str,
    values: dict[str, float],
    folder: Path,
    *,
    warm: bool = False,
    harmonics: int = 8,
    digits: int = 18,
) -> list[Finding]:
    """Findings about the log of an arm whose second joint has an effect that the set-up does not list."""
    columns = {
        "time": "t",
        "position": "q{n}",
        "output": "tau{n}",
        **({"input": {"j2": "warmth"}} if warm else {}),
    }
    for name, more in (("true", f", {planted}" if planted else ""), ("known", "")):
        effects = f"effects: [usual, {{type: rotor_inertia, at: all}}{more}]"
        (folder / f"{name}.yaml").write_text(
            f"{ARM}, {effects}, log: {json.dumps(columns)}}}"
        )
    base = ec.base_parameters(ec.load_setup(folder / "true.yaml").mechanism)
    known = VALUES | values
    effects_of = [known.get(name, known.get(name[:2])) for name in base.parameters[30:]]
    zeta = base.values([*map(float, BODIES.split()), *effects_of])
    q, qd, qdd = fourier(np.random.default_rng(1), 3, 0.9, harmonics=harmonics)
    tau, warmth = np.zeros_like(q), np.linspace(0, 8, len(q))
    for _ in range(20):  # friction that grows with the load depends on itself
        tau = base.predict(
            q, qd, qdd, zeta, inputs={"j2": warmth if warm else tau[:, 1]}
        )
    tau += 0.05 * np.random.default_rng(2).normal(size=q.shape)
    table = np.column_stack(
        [np.arange(len(q)) / RATE, np.round(q, digits), tau, warmth]
    )
    np.savetxt(
        folder / "run.csv",
        table,
        delimiter=",",
        header="t,q1,q2,q3,tau1,tau2,tau3,warmth",
        comments="",
    )
    setup = ec.load_setup(folder / "known.yaml").with_settings(physical=False)
    return [
        f
        for f in ec.identify(setup, [folder / "run.csv"]).findings
        if f.kind == "missing effect"
    ]


PLANTED = {
    "nothing": ("", {}, ""),
    "asymmetric": (
        "{type: asymmetric_viscous, at: j2}",
        {"Fvp2": 2.0, "Fvn2": 0.0},
        "asymmetric_viscous, at: [j2]",
    ),
    "stribeck": (
        "{type: stribeck, at: j2, velocity: 0.15}",
        {"Fs2": 3.0},
        "{type: stribeck, at: [j2], velocity: 0.",
    ),
    "load": (
        "{type: load_friction, at: j2}",
        {"Fl2": 0.1},
        "{type: load_friction, at: [j2]}",
    ),
    "spring": (
        "{type: spring, at: j2}",
        {"Ks2": 20.0, "Ps2": 3.0},
        "{type: spring, at: [j2]}",
    ),
    "cable": (
        "{type: cable, at: j2}",
        {"Kc2": 3.0, "Kcc2": 2.0, "Kccc2": 6.0},
        "{type: cable, at: [j2]}",
    ),
    "ripple": (
        "{type: ripple, at: j2, harmonic: 6}",
        {"Rs6_2": 2.0, "Rc6_2": -1.0},
        "ripple, at: [j2], harmonic: 6}",
    ),
    "another joint": (
        '{parameter: X, unit: N·m·s/rad, acts: [{at: j2, term: "qd[j3]"}]}',
        {"X": 2.0},
        'acts: [{at: j2, term: "qd[j3]"}]',
    ),
}


@pytest.mark.parametrize(
    "name",
    [
        "nothing",
        "load",
        *(pytest.param(n, marks=pytest.mark.slow) for n in PLANTED),
    ],
)
def test_planted_effects_are_named(name: str, tmp_path: Path) -> None:
    planted, values, line = PLANTED[name]
    found = missing(planted, values, tmp_path)
    assert len(found) <= bool(planted)
    assert all(
        line in finding.text and "to 'effects'" in finding.text for finding in found
    )
    assert len(found) == bool(planted)


def test_dry_friction_of_slow_motion_is_no_stribeck_friction(tmp_path: Path) -> None:
    """The band is so low that effects are looked for on a clock many times slower than the log's."""
    assert not missing("", {"Fc": 40.0}, tmp_path, harmonics=5, digits=3)


def test_friction_that_follows_a_temperature(tmp_path: Path) -> None:
    planted = "{type: temperature_friction, at: j2}"
    (found,) = missing(planted, {"FvT2": 0.3, "FcT2": 0.2}, tmp_path, warm=True)
    assert "{type: temperature_friction, at: [j2]}" in found.text


@pytest.mark.slow
def test_rotors_that_are_left_out_are_the_first_remark(tmp_path: Path) -> None:
    """MuJoCo simulates an arm with geared motors."""
    system = SYSTEMS["arm"]
    setup = system.load(
        tmp_path,
        effects=[{"type": "viscous", "at": "all"}, {"type": "coulomb", "at": "all"}],
    )
    log = system.log(motion_of(system), tmp_path / "run", setup.mechanism)
    first = ec.identify(setup.with_settings(physical=False), [log]).findings[0]
    assert first.text.startswith("residuals follow the acceleration qdd")
    assert "{type: rotor_inertia, at: [j3, j4, j5]}" in first.text


QUIET_ARM = replace(SHORT_ARM, noise=(0.25, 0.4, 0.2))


@pytest.mark.parametrize(
    "stated", [{}, pytest.param({"effects": ["usual"]}, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    ("system", "joints"),
    one_in(2, [(QUIET_ARM, ["j3"]), (SYSTEMS["arm"], ["j3", "j4", "j5"])]),
)
def test_rotors_that_nobody_mentioned_are_tried(
    system: System, joints: list[str], stated: dict[str, list[str]], tmp_path: Path
) -> None:
    content = {k: v for k, v in system.setup.items() if k != "effects"}
    system = replace(system, setup=content)
    setup = system.load(tmp_path, **stated)
    log = system.log(motion_of(system), tmp_path / "run", setup.mechanism)
    result = ec.identify(setup.with_settings(physical=False), [log])
    rotors = {joint.replace("j", "Ia") for joint in joints}
    assert rotors <= {*result.base.mechanism.parameters}
    assert min(score.r2 for score in result.validations[-1].scores) > 0.998
    effect = f"{{type: rotor_inertia, at: [{', '.join(joints)}]}}"
    line = f"write effects: [usual, {effect}]"
    if stated:
        line = f"add {effect} to 'effects'"
    assert line in result.findings[0].text
    assert [finding.kind for finding in result.findings].count("missing effect") == 1


@pytest.mark.slow
def test_rotors_that_are_left_out_are_no_wrong_clock(tmp_path: Path) -> None:
    """Where gravity says nothing, more inertia looks like a faster clock."""
    parts = (
        Part("upper", "", (0, 0, 0), "j1", (0, 0, 1), 4.0, 0.3),
        Part("fore", "upper", (0.4, 0, 0), "j2", (0, 0, 1)),
    )
    drives = {"j1": Drive(0.5, 0.4, 0.3), "j2": Drive(0.3, 0.2, 0.2)}
    effects = [{"type": "viscous", "at": "all"}, {"type": "coulomb", "at": "all"}]
    system = replace(
        SYSTEMS["arm"],
        name="flat",
        parts=parts,
        drives=drives,
        noise=(0.05, 0.03),
        simulated=False,
    )
    setup = system.load(tmp_path, effects=effects)
    result = ec.identify(
        setup, [system.log(system.motion(11), tmp_path / "run", setup.mechanism)]
    )
    assert "{type: rotor_inertia, at: [j2]}" in result.findings[0].text
    assert not {"setup error", "gains"} & {finding.kind for finding in result.findings}
