"""Set-up files: what they say of logs, preparation and fits, and what is said about mistakes in them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import echelon as ec
from echelon.identification.logs.columns.column_map import Channel
from echelon.identification.setup.setup import Setup, load_setup
from support.paths import ROOT

EXAMPLES = sorted(
    [*(ROOT / "examples" / "logs").glob("*.yaml"), ROOT / "examples" / "tx40.yaml"]
)

ARM = """
echelon: 1
name: arm
symbols: {gear: 100, l1: 0.5}
modified_dh:
  - {joint: revolute}
  - {joint: revolute, a: l1}
actuators: {m1: gear*j1, m2: gear*j1 + gear*j2}
outputs: [{joint: all}]
"""


def read(tmp_path: Path, text: str, base: str = ARM) -> Setup:
    file = tmp_path / "arm.yaml"
    file.write_text(base + text, encoding="utf-8")
    return load_setup(file)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda f: f.stem)
def test_examples_name_every_position_and_output(file: Path) -> None:
    setup = load_setup(file)
    drives = [actuator.name for actuator in setup.mechanism.actuators]
    # a motor that turns by itself has a coordinate of its own
    own = {
        a.name: a.terms[0][0] for a in setup.mechanism.actuators if len(a.terms) == 1
    }
    for columns in setup.columns:
        named = {*columns.positions}
        if setup.mechanism.springs:
            named = {own.get(name, name) for name in named}
        assert named in ({*setup.mechanism.positions}, {*drives})
        assert set(columns.outputs) in (
            {output.name for output in setup.mechanism.sensed},
            {*drives},
        )


def test_columns_by_template_by_drive_and_by_name(tmp_path: Path) -> None:
    setup = read(
        tmp_path,
        """
log:
  rate: 1000
  position:
    actuators: {column: "theta_{n}", unit: deg}
    m2: {column: odd, scale: -gear/10000, offset: -pi/2}
  velocity: "v[{i}]"
  output: {all: "tau_{name}"}
""",
    )
    (columns,) = setup.columns
    assert columns.rate == 1000
    assert columns.time is None
    assert columns.positions == {
        "m1": Channel("theta_1", "deg"),
        "m2": Channel("odd", "", -0.01, -math.pi / 2),
    }
    assert columns.velocities == {"j1": Channel("v[0]"), "j2": Channel("v[1]")}
    assert columns.outputs == {"j1": Channel("tau_j1"), "j2": Channel("tau_j2")}


def test_several_kinds_of_logs(tmp_path: Path) -> None:
    one = '{time: t, position: "q{n}", output: "y{n}"}'
    setup = read(tmp_path, f"log:\n  - {one}\n  - {one.replace('t,', 'stamp,')}\n")
    assert [columns.time for columns in setup.columns] == [
        Channel("t"),
        Channel("stamp"),
    ]
    with pytest.raises(ec.InputError, match=r"log\[1\]\.position"):
        read(tmp_path, f"log:\n  - {one}\n  - {one.replace('q{n}', 'q')}\n")


def test_preparation_and_settings(tmp_path: Path) -> None:
    setup = read(
        tmp_path,
        """
preparation: {band: inf, measured: qd, still: {j1: 0.01}, delays: {}}
identification:
  estimator: huber
  known: {Ia1: 0.25}
  predict: physical
  bodies: {j2: {mass: [1, 2], symmetry: [xz]}}
  parameters: {M2: [0, inf]}
  prior: {weight: 3}
""",
    )
    assert setup.preparation.band == math.inf
    assert setup.preparation.measured == ("qd",)
    assert setup.preparation.still == {"j1": 0.01}
    assert setup.preparation.delays == {}
    settings = setup.settings
    assert (settings.estimator, settings.predict, settings.prior.weight) == (
        "huber",
        "physical",
        3,
    )
    assert settings.known == {"Ia1": 0.25}
    assert settings.bodies["j2"].model_dump(exclude_unset=True) == {
        "mass": (1, 2),
        "symmetry": ("xz",),
    }
    assert settings.parameters == {"M2": (0, math.inf)}


def test_a_robot_file_stands_for_a_set_up() -> None:
    setup = load_setup(ROOT / "examples" / "two_link.xml")
    assert setup.columns == ()
    assert {"Fv1", "Fc1", "Fo1"} <= set(setup.mechanism.parameters)
    assert setup.robot_file is not None
    assert setup.robot_file.source == str(ROOT / "examples" / "two_link.xml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            'log: {time: t, rate: 10, position: "q{n}"}',
            "log: give time or rate, not both",
        ),
        (
            "log: {position: {j3: q3}}",
            "log.position.j3: there is no such coordinate, output or drive",
        ),
        ('log: {position: {j1: {colum: "q"}}}', "did you mean 'column'?"),
        ("log: {position: q}", "'q' is one column for several channels"),
        (
            "log: {position: {m1: {column: q, offset: 3*k}}}",
            "'k' in '3*k' has no value",
        ),
        ("log: {position: {m1: {column: q, scale: 0}}}", "must be finite and not zero"),
        ("preparation: {band: -3}", "preparation.band"),
        ("preparation: {measured: [qdx]}", "preparation.measured"),
        ("preparation: {bandd: 3}", "did you mean 'band'?"),
        ("identification: {estimator: olss}", "did you mean 'ols'?"),
        (
            "identification: {physical: false, predict: physical}",
            "a physical fit that is switched off",
        ),
        ("identification: {level: 1.5}", "identification.level"),
        (
            "identification: {known: {Fv1: x}}",
            "needs a number or an expression of numbers and pi, found 'x'",
        ),
    ],
)
def test_mistakes_are_named_with_their_place(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(ec.InputError) as caught:
        read(tmp_path, text)
    assert said in str(caught.value)
    assert "arm.yaml" in str(caught.value)
    assert "line" in str(caught.value)
