"""Inclinometers and other sensors of combinations of coordinates, as hydraulic excavators have them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.columns.conversion import recording
from echelon.identification.logs.columns.motion_sensors import inclinometer
from echelon.identification.logs.files.log_file import Table
from support.column_maps import Floats

# the axis of the stick points the other way, the frame of the bucket stands upright on the stick
EXCAVATOR = """
echelon: 1
name: excavator
bodies:
  - {name: upper, joint: {name: swing, type: revolute, axis: z, origin: {xyz: [0, 0, 1]}}}
  - {name: boom, parent: upper, joint: {name: j2, type: revolute, axis: y, origin: {xyz: [0.2, 0, 0.5]}}}
  - {name: stick, parent: boom, joint: {name: j3, type: revolute, axis: [0, -1, 0], origin: {xyz: [2, 0, 0]}}}
  - name: bucket
    parent: stick
    joint: {name: j4, type: revolute, axis: y, origin: {xyz: [1.5, 0, 0], rpy: [0, pi/2, 0]}}
"""
EFFECTS = """
effects: [{type: viscous, at: all}, {type: coulomb, at: all}, {type: offset, at: all}]
"""
SENSORS = """
log:
  time: t
  sensors:
    tilt_boom: {body: boom}
    tilt_stick: {body: stick}
    tilt_bucket: {body: bucket, axis: z}
  position:
    swing: swing
    tilt_boom: {column: boom, unit: deg}
    tilt_stick: {column: stick, unit: deg, scale: -1, offset: 0.1}
    tilt_bucket: bucket
  output: {all: "tau_{name}"}
"""
RATE = 200.0  # Hz
NOISE = 2.0  # of torques, N·m


def described(text: str, folder: Path) -> ec.Setup:
    file = folder / "excavator.yaml"
    file.write_text(text)
    return ec.load_setup(file)


def about(axis: str, angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    turns = {
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
    }
    return np.array(turns[axis])


def upright(pointing: Floats, level: Floats) -> float:
    """The angle from the vertical to a direction, about a level axis by the right-hand rule."""
    up = np.array([0.0, 0.0, 1.0])
    return float(np.arctan2(np.cross(up, pointing) @ level, pointing @ up))


def tilts(q: Floats) -> dict[str, Floats]:
    """Angles of the bodies to the vertical by rotation matrices, rad."""
    rows = []
    for swing, j2, j3, j4 in q:
        boom = about("z", swing) @ about("y", j2)
        stick = boom @ about("y", -j3)
        bucket = stick @ about("y", np.pi / 2) @ about("y", j4)
        level = boom[:, 1]
        rows.append(
            [
                upright(boom[:, 0], level),
                upright(stick[:, 0], -level),
                upright(bucket[:, 2], level),
            ]
        )
    columns = np.unwrap(np.array(rows), axis=0).T
    return dict(zip(("boom", "stick", "bucket"), columns, strict=True))


def motion(seconds: float = 10.0) -> tuple[Floats, Floats, Floats, Floats]:
    """Times, positions, velocities and accelerations of two sines in every joint."""
    t = np.arange(seconds * RATE) / RATE
    rates = np.array([[1.1, 4.3], [1.7, 5.3], [2.3, 6.1], [2.9, 7.1]])
    sizes = np.array([[0.5, 0.3], [0.25, 0.15], [0.25, 0.15], [0.25, 0.15]])
    phase = t[:, None, None] * rates
    q = (sizes * np.sin(phase)).sum(axis=2) + np.array([0, -0.6, -0.4, -0.5])
    qd = (sizes * rates * np.cos(phase)).sum(axis=2)
    qdd = -(sizes * rates**2 * np.sin(phase)).sum(axis=2)
    return t, q, qd, qdd


def planted(setup: ec.Setup) -> tuple[ec.BaseModel, Floats]:
    """Base parameters of bodies that can exist, and of friction."""
    base = ec.base_parameters(setup.mechanism)
    sizes = {"M": 20.0, "MX": 8.0, "MZ": 1.0, "XX": 2.0, "YY": 5.0, "ZZ": 5.0}
    kinds = [name.rstrip("0123456789") for name in setup.mechanism.parameters]
    friction = {"Fv": 3.0, "Fc": 2.0, "Fo": 0.5}
    return base, base.values([{**sizes, **friction}.get(kind, 0.0) for kind in kinds])


def logged(setup: ec.Setup, zero: float = 0.0) -> dict[str, Floats]:
    """A log, in which the inclinometer of the boom shows too much by some angle, rad."""
    t, q, qd, qdd = motion()
    base, values = planted(setup)
    torques = base.predict(q, qd, qdd, values)
    torques = torques + NOISE * np.random.default_rng(1).normal(size=torques.shape)
    shown = tilts(q)
    full_turn = 360.0
    boom = np.degrees(shown["boom"] + zero)
    return {
        "t": t,
        "swing": q[:, 0],
        "boom": np.mod(boom + full_turn / 2, full_turn) - full_turn / 2,
        "stick": -np.degrees(shown["stick"] - 0.1),
        "bucket": shown["bucket"],
        **{
            f"tau_{name}": column
            for name, column in zip(setup.mechanism.velocities, torques.T, strict=True)
        },
    }


def test_angles_to_the_vertical_are_sums_of_coordinates(tmp_path: Path) -> None:
    setup = described(EXCAVATOR + SENSORS, tmp_path)
    found = setup.columns[0].sensors
    assert found["tilt_boom"].weights == {"j2": 1.0}
    assert found["tilt_stick"].weights == {"j2": -1.0, "j3": 1.0}
    assert found["tilt_bucket"].weights == {"j2": 1.0, "j3": -1.0, "j4": 1.0}
    q = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 4))
    for name, shown in tilts(q).items():
        sensor = found[f"tilt_{name}"]
        weights = [
            sensor.weights.get(joint, 0.0) for joint in setup.mechanism.positions
        ]
        assert np.allclose(np.exp(1j * (q @ weights + sensor.zero - shown)), 1)


def test_positions_and_velocities_follow_from_sensors(tmp_path: Path) -> None:
    text = (
        EXCAVATOR
        + """
log:
  rate: 200
  sensors: {rope: {terms: {j2: 2, j3: 1}}, sum: j2 - j3/2 + pi/4, gyro: j2 - j3}
  position: {swing: swing, rope: rope, sum: {column: sum, unit: deg}, j4: j4}
  velocity: {swing: swing, gyro: gyro, j3: j3, j4: j4}
"""
    )
    setup = described(text, tmp_path)
    q = np.random.default_rng(0).normal(size=(50, 4))
    columns = {
        **dict(zip(("swing", "j2", "j3", "j4"), q.T, strict=True)),
        "rope": q @ [0, 2, 1, 0],
        "sum": np.degrees(q @ [0, 1, -0.5, 0] + np.pi / 4),
        "gyro": q @ [0, 1, -1, 0],
    }
    found = recording(Table("run", columns), setup.columns[0], setup.mechanism)
    assert np.allclose(found.signals["q"], q, atol=1e-12)
    assert np.allclose(found.signals["qd"], q, atol=1e-12)


def test_a_locked_joint_is_a_number_in_a_combination(tmp_path: Path) -> None:
    text = (
        EXCAVATOR
        + """
locked: {j2: 0.3}
log:
  rate: 200
  sensors: {sum: j2 - j3, tilt: {body: stick}}
  position: {swing: q, sum: q, j4: q}
"""
    )
    columns = described(text, tmp_path).columns[0]
    assert columns.sensors["sum"].weights == {"j3": -1.0}
    assert columns.sensors["sum"].zero == pytest.approx(0.3)
    assert columns.sensors["tilt"].weights == {"j3": 1.0}
    assert columns.sensors["tilt"].zero == pytest.approx(-np.pi / 2 - 0.3)


def test_a_coupled_joint_counts_by_its_ratio(tmp_path: Path) -> None:
    setup = described(EXCAVATOR + "couplings: [{j3: 2*j2 + 0.1}]\n", tmp_path)
    found = inclinometer(setup.mechanism, "stick", "x")
    assert found.weights == {"j2": 1.0}  # 2 j2 about -y less j2 about y
    assert found.zero == pytest.approx(0.1 - np.pi / 2)


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        ("{tilt: {body: stik}}", r"sensors\.tilt\.body.*no such body.*stick"),
        ("{tilt: {body: upper}}", "no joint tilts this body"),
        ("{tilt: {body: boom, axis: y}}", r"y axis does not lie.*write axis: x"),
        ("{tilt: {terms: {j9: 1}}}", r"tilt\.terms\.j9.*no such coordinate"),
        ("{tilt: {body: boom, terms: {j2: 1}}}", "exactly one of terms, body"),
        ("{tilt: j2*j3}", "not linear"),
        ("{tilt: j2^2}", "not linear"),
        ("{tilt: sin(j2)}", "not linear"),
        ("{tilt: j2 + j9}", "'j9' in 'j2 . j9' has no value"),
        ("{tilt: 1.5}", "has no coordinate of the robot .swing, j2, j3, j4."),
        ("{j2: j2 + j3}", "choose another name"),
        ("{all: j2 + j3}", "choose another name"),
    ],
)
def test_sensors_that_are_none(tmp_path: Path, sensors: str, message: str) -> None:
    text = f"{EXCAVATOR}\nlog: {{rate: 100, sensors: {sensors}, position: 'q_{{n}}'}}\n"
    with pytest.raises(ec.InputError, match=message):
        described(text, tmp_path)


def test_angles_that_are_no_sums_are_refused(tmp_path: Path) -> None:
    def refusal(robot: str, body: str = "boom") -> str:
        with pytest.raises(ec.InputError) as caught:
            inclinometer(described(robot, tmp_path).mechanism, body, "x")
        return caught.value.problem

    leaning = EXCAVATOR.replace("type: revolute, axis: z", "type: revolute, axis: x")
    assert "joint 'j2' turns neither about the vertical" in refusal(leaning)
    rolling = EXCAVATOR.replace("axis: [0, -1, 0]", "axis: [1, 0, 0]")
    assert "joint 'j3' turns neither" in refusal(rolling, "stick")
    ball = EXCAVATOR.replace("type: revolute, axis: z", "type: spherical")
    assert "log its position" in refusal(ball)
    assert "without gravity nothing is vertical" in refusal(
        EXCAVATOR + "gravity: none\n"
    )
    sloping = EXCAVATOR + "gravity: [1, 0, -9.75]\n"
    assert "joint 'swing' turns neither" in refusal(sloping)


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ("{swing: q, j3: q, tilt: q, other: q, j4: q}", "more than once"),
        ("{swing: q, j2: q, tilt: q}", "columns are missing for j3, j4"),
        ("{swing: q, tilt: q, twice: q, j4: q}", "tilt, twice do not determine j2, j3"),
        ("{swing: q, tlt: q}", "no such coordinate, output or drive.*tilt"),
        ("{swing: q, tilt: {column: q, unit: mm}, j3: q, j4: q}", "mm.*rad"),
    ],
)
def test_columns_that_do_not_give_all_positions(
    tmp_path: Path, position: str, message: str
) -> None:
    sensors = "{tilt: j2 + j3, other: j2 - j3, twice: 2*j2 + 2*j3}"
    text = (
        f"{EXCAVATOR}\nlog: {{rate: 100, sensors: {sensors}, position: {position}}}\n"
    )
    table = Table("run", {"q": np.zeros(30)})

    def read() -> None:
        setup = described(text, tmp_path)
        recording(table, setup.columns[0], setup.mechanism)

    with pytest.raises(ec.InputError, match=message):
        read()


def test_outputs_have_no_sensors_of_motion(tmp_path: Path) -> None:
    text = f"{EXCAVATOR}\nlog: {{sensors: {{tilt: j2}}, position: 'q_{{n}}', output: {{tilt: q}}}}\n"
    with pytest.raises(ec.InputError, match=r"log\.output\.tilt"):
        described(text, tmp_path)


def test_a_log_with_inclinometers_gives_the_planted_parameters(tmp_path: Path) -> None:
    setup = described(EXCAVATOR + EFFECTS + SENSORS, tmp_path)
    result = ec.identify(setup, logged(setup))
    assert min(score.r2 for score in result.validations[-1].scores) > 0.99
    _, values = planted(setup)
    estimate = result.estimate
    deviations = np.sqrt(np.diag(estimate.covariance))
    assert np.all(np.abs(estimate.values - values) < 5 * deviations)
    assert not any("zero" in str(finding) for finding in result.findings)
    ec.save_identification(result, tmp_path / "model.json")
    model = ec.load_identified(tmp_path / "model.json")
    assert model.columns[0].sensors == setup.columns[0].sensors


def test_a_wrong_zero_is_that_of_the_inclinometer(tmp_path: Path) -> None:
    setup = described(EXCAVATOR + EFFECTS + SENSORS, tmp_path)
    result = ec.identify(setup, logged(setup, zero=0.06))
    texts = [str(finding) for finding in result.findings]
    assert any("position of 'tilt_boom' (column 'boom')" in text for text in texts), (
        texts
    )


def test_maps_without_set_ups_have_sensors_too(tmp_path: Path) -> None:
    mechanism = described(EXCAVATOR, tmp_path).mechanism
    columns = ColumnMap(
        rate=RATE,
        positions={name: Channel(name) for name in ("swing", "j2", "tilt", "j4")},
        sensors={"tilt": inclinometer(mechanism, "stick", "x")},
    )
    q = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 4))
    table = Table(
        "run",
        {"swing": q[:, 0], "j2": q[:, 1], "tilt": tilts(q)["stick"], "j4": q[:, 3]},
    )
    found = recording(table, columns, mechanism).signals["q"]
    assert np.allclose(np.exp(1j * found), np.exp(1j * q), atol=1e-12)
