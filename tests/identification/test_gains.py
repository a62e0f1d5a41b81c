"""Drive gains from simulated currents: recovered, covered by their intervals, refused where nothing fixes the scale."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.compute.observe.observation import Layout, Observation
from echelon.compute.observe.triangle import upper_triangle
from echelon.formats.snapping import ReadingOptions
from echelon.identification.current_fit import fit_currents, gain_names
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.gains import drive_gains
from echelon.identification.judge.evidence import States
from echelon.identification.judge.hypothesis import Kind
from echelon.identification.judge.judge import Judge
from echelon.identification.judge.readings import Readings
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.recording import Samples
from echelon.identification.payload import JoinedRows, Payload, loaded_rows, with_zeros
from echelon.identification.rows.rows import ModelRows
from echelon.identification.setup.setup import Setup
from echelon.robot.effect import Side, ready_made
from echelon.robot.joint import translation
from echelon.shared import Floats
from support.descriptions import read_description
from support.observation_rows import ArrayRows
from support.paths import EXAMPLES
from support.payloads import LOAD, Truth, truth, with_drives
from support.simulated_systems import SYSTEMS, motion_of
from support.textbook_arms import body, modified_dh, tree
from support.textbook_arms import puma560 as puma


@pytest.fixture(scope="module")
def six() -> Truth:
    return truth(puma(), "link6")


@pytest.fixture(scope="module")
def three() -> Truth:
    rows = ("R 0 0 0", "R -pi/2 0 0", "R 0 a2 0")
    return truth(
        modified_dh("elbow", *rows, values={"a2": "0.4", "g": "9.81"}), "link3"
    )


# -- the payload's columns --------------------------------------------------------------------------------------------


def test_a_payload_adds_to_the_body_that_carries_it(six: Truth) -> None:
    """Columns of the payload are those of the body: moving LOAD there gives the same torques."""
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(3, 20, 6))
    extra = np.zeros(len(six.base.parameters))
    place = six.base.mechanism.first_column[5]
    extra[place : place + 10] = LOAD
    zeros = {name: np.zeros(20) for name in six.base.mechanism.velocities}
    expected = six.base.predict(q, qd, qdd, six.base.values(extra), inputs=zeros)
    np.testing.assert_allclose(
        six.load.predict(q, qd, qdd, six.load_values), expected, atol=1e-10
    )
    assert six.load.rank == 10


def test_unknown_parameters_come_first(six: Truth) -> None:
    payload = Payload("link6", {"M": 4.9})
    load = payload.base(six.base)
    assert load.pivots[-1] == "M_payload"
    assert payload.known_values(load) == {"M_payload": 4.9}
    some = Payload("link6", {"MZ": 0.34, "M": 4.9})
    assert some.known_values(some.base(six.base)) == pytest.approx(
        {"MZ_payload": 0.34, "M_payload": 4.9}
    )


def test_rows_of_robot_and_payload_stand_side_by_side(three: Truth) -> None:
    samples = three.run(1, 0.0, loaded=True, count=50)
    rows = loaded_rows(three.base, Payload.of("link3", LOAD), [samples])
    full = np.concatenate([three.values, three.load_values])
    for block in rows.blocks():
        for output, matrix in enumerate(block.matrices):
            residual = matrix @ full[list(rows.layout.columns[output])]
            np.testing.assert_allclose(residual, 0, atol=1e-9)
    misfit = rows.observation().misfits(full)
    np.testing.assert_allclose(misfit, 0, atol=1e-8)
    assert rows.observation().counts == (50, 50, 50)


# -- recovery ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", ["all", "mass"])
def test_without_noise_everything_is_recovered(six: Truth, known: str) -> None:
    payload = (
        Payload.of("link6", LOAD)
        if known == "all"
        else Payload("link6", {"M": LOAD[-1]})
    )
    free, loaded = six.observations(0, 0.0, payload)
    found = drive_gains(six.base, free, loaded, payload)
    np.testing.assert_allclose(found.gains, six.gains, rtol=1e-5)
    np.testing.assert_allclose(
        found.estimate.values[: six.base.rank], six.values, rtol=1e-3, atol=1e-4
    )
    load = payload.base(six.base)
    np.testing.assert_allclose(
        found.estimate.values[six.base.rank :], load.values(LOAD), rtol=1e-3, atol=1e-4
    )
    assert not found.unclear
    assert "link6" in found.scale


def test_gains_are_recovered_from_noisy_currents(six: Truth) -> None:
    payload = Payload.of("link6", LOAD)
    free, loaded = six.observations(1, 0.02, payload)
    found = drive_gains(six.base, free, loaded, payload)
    np.testing.assert_allclose(found.gains, six.gains, rtol=0.05)
    error = (found.gains - six.gains) / found.std
    assert np.abs(error).max() < 4
    runs = [six.run(2, 0.02, loaded=False), six.run(3, 0.02, loaded=True)]
    squares = [
        np.mean([np.mean(run.inputs[name] ** 2) for run in runs])
        for name in six.base.mechanism.velocities
    ]
    np.testing.assert_allclose(
        found.estimate.diagnostics["current_noise"], 0.02 * np.sqrt(squares), rtol=0.05
    )


@pytest.mark.slow
def test_intervals_cover_at_their_rate(three: Truth) -> None:
    """Forty runs with other noise and other motions; the gains are not biased."""
    payload = Payload("link3", {"M": LOAD[-1]})
    inside, errors = [], []
    for seed in range(40):
        observations = three.observations(seed, 0.1, payload, 600)
        found = drive_gains(three.base, *observations, payload)
        low, high = found.interval(0.9).T
        inside.append((low < three.gains) & (three.gains < high))
        errors.append(found.gains / three.gains - 1)
    # 120 intervals; those of one run depend on each other through the common scale
    assert 0.8 < np.mean(inside) < 0.97
    assert abs(np.mean(errors)) < 2 * np.std(errors) / np.sqrt(40)


def test_one_known_gain_or_parameter_fixes_the_scale(three: Truth) -> None:
    free = ModelRows.of(
        three.base, [with_zeros(three.base, three.run(5, 0.01, loaded=False))]
    )
    found = drive_gains(three.base, free, known={"Kt1": three.gains[0]})
    np.testing.assert_allclose(found.gains, three.gains, rtol=0.05)
    assert found.std[0] == 0
    assert found.gains[0] == three.gains[0]
    assert found.scale.startswith("Kt1 = ")
    name = "MX2"
    value = three.values[three.base.pivots.index(name)]
    by_mass = drive_gains(three.base, free, known={name: value})
    np.testing.assert_allclose(by_mass.gains, three.gains, rtol=0.05)
    twice = drive_gains(three.base, free, known={name: 2 * value})
    np.testing.assert_allclose(twice.gains, 2 * by_mass.gains, rtol=1e-6)
    np.testing.assert_allclose(
        twice.estimate.values, 2 * by_mass.estimate.values, rtol=1e-4, atol=1e-6
    )


def test_gains_of_coupled_drives() -> None:
    """Each motor moves both joints; the gains are those of the motors."""
    row = {"joint": "revolute", "alpha": "pi/2", "a": "0.3"}
    data = {
        "echelon": 1,
        "name": "differential",
        "modified_dh": [{"joint": "revolute"}, row],
        "gravity": [0, "-9.81", 0],
        "actuators": {"a": "30*j1 + 20*j2", "b": "-10*j1 + 50*j2"},
        "effects": [
            {"type": "viscous", "at": "all"},
            {"type": "drive_gain", "at": ["a", "b"]},
        ],
    }
    base = ec.base_parameters(
        read_description(json.dumps(data), "differential", ReadingOptions())
    )
    names = gain_names(base)
    assert len(names) == 2
    payload = Payload.of(base.mechanism.bodies[1].name, LOAD)
    load = payload.base(base)
    values = np.random.default_rng(3).uniform(0.5, 2, base.rank)
    gains = np.array([0.3, 0.5])
    values[[base.pivots.index(name) for name in names]] = 0
    runs = []
    for seed in (0, 1):
        q, qd, qdd = np.random.default_rng(seed).normal(size=(3, 200, 2))
        torque = base.predict(
            q, qd, qdd, values, inputs={"a": np.zeros(200), "b": np.zeros(200)}
        )
        torque = torque + seed * load.predict(q, qd, qdd, load.values(LOAD))
        currents = dict(zip("ab", (torque / gains).T, strict=True))
        runs.append(Samples("run", 0.0, 100.0, q, qd, qdd, None, currents))
    free = ModelRows.of(base, [with_zeros(base, runs[0])])
    found = drive_gains(base, free, loaded_rows(base, payload, runs[1:]), payload)
    np.testing.assert_allclose(found.gains, gains, rtol=1e-6)
    assert found.units == ("N·m/A", "N·m/A")


# -- what cannot be ---------------------------------------------------------------------------------------------------


def test_without_anything_known_only_ratios_are_seen(three: Truth) -> None:
    free = ModelRows.of(
        three.base, [with_zeros(three.base, three.run(5, 0.01, loaded=False))]
    )
    with pytest.raises(
        ec.InputError, match="only ratios of Kt1, Kt2, Kt3 and the masses"
    ):
        drive_gains(three.base, free)


def test_a_drive_that_shares_nothing_has_its_own_scale() -> None:
    """Parallel slides: the load on one says nothing of the other."""
    arm = tree(
        "slides",
        *(body(k, 0, "prismatic", translation(f"q{k}", k - 1)) for k in (1, 2)),
        values={"g": "9.81"},
    )
    effects = [
        e
        for k in (1, 2)
        for e in ready_made("drive_gain", f"q{k}", Side.ACTUATOR, str(k), sliding=True)
    ]
    base = ec.base_parameters(replace(arm, effects=tuple(effects)))
    rng = np.random.default_rng(2)
    qdd = rng.normal(size=(30, 2))
    samples = Samples(
        "run",
        0.0,
        10.0,
        qdd,
        qdd,
        qdd,
        None,
        {"q1": 3 * qdd[:, 0], "q2": 2 * qdd[:, 1]},
    )
    heavier = replace(samples, inputs={"q1": 4 * qdd[:, 0], "q2": 2 * qdd[:, 1]})
    free = ModelRows.of(base, [with_zeros(base, samples)])
    payload = Payload("link1", {"M": 5.0})
    with pytest.raises(ec.InputError, match="only ratios of Kt2 and the masses"):
        drive_gains(base, free, loaded_rows(base, payload, [heavier]), payload)
    # the mass 3 K, with five kilograms more 4 K
    found = drive_gains(
        base, free, loaded_rows(base, payload, [heavier]), payload, known={"Kt2": 2.0}
    )
    np.testing.assert_allclose(found.estimate.values, [15, 4, 5, 2, 5], rtol=1e-9)


def test_a_mass_that_no_output_tells_from_the_unknown_is_refused() -> None:
    """A load on a vertical axis shows its moment of inertia alone."""
    base = ec.base_parameters(
        with_drives(modified_dh("turntable", "R 0 0 0", values={"g": "9.81"}))
    )
    samples = Samples(
        "run",
        0.0,
        1.0,
        *np.random.default_rng(0).normal(size=(3, 20, 1)),
        None,
        {"q1": np.ones(20)},
    )
    free = ModelRows.of(base, [with_zeros(base, samples)])
    payload = Payload("link1", {"M": 5.0})
    with pytest.raises(ec.InputError, match="cannot be separated"):
        drive_gains(base, free, loaded_rows(base, payload, [samples]), payload)


def test_currents_given_as_outputs_too_are_refused(three: Truth) -> None:
    samples = three.run(5, 0.01, loaded=False)
    twice = replace(samples, y=np.stack(list(samples.inputs.values()), axis=1))
    with pytest.raises(ec.InputError, match=r"output 'q1': .*must be zero"):
        drive_gains(
            three.base,
            ModelRows.of(three.base, [twice]),
            known={"Kt1": 1.0, "Kt2": 1.0},
        )


def test_currents_without_relation_to_the_motion_have_unclear_gains(
    three: Truth,
) -> None:
    samples = three.run(5, 0.01, loaded=False)
    rng = np.random.default_rng(9)
    strange = replace(
        samples, inputs={**samples.inputs, "q3": rng.normal(size=len(samples))}
    )
    free = ModelRows.of(three.base, [with_zeros(three.base, strange)])
    try:
        found = drive_gains(three.base, free, known={"Kt1": three.gains[0]})
    except ec.InputError as error:
        assert "hardly follow" in str(error) or "do not determine" in str(error)  # noqa: PT017
    else:
        assert "Kt3" in found.unclear


def test_the_gain_of_currents_that_do_not_follow_the_model_is_refused() -> None:
    """Least squares then make it as large as doubles allow, until nothing is left of its column."""
    rng = np.random.default_rng(0)
    x, noise = rng.normal(size=(2, 400))
    i = noise - x * (x @ noise) / (x @ x)
    layout = Layout(("a", "b"), ("m", "K"), ((0,), (0, 1)))

    def fitted(current: Floats) -> Estimate:
        rows = [np.column_stack([x, 2 * x + 0.1 * rng.normal(size=400)])]
        rows += [np.column_stack([x, -current, np.zeros(400)])]
        factors = tuple(upper_triangle(some) for some in rows)
        observation = Observation(layout, factors, (400, 400))
        return fit_currents(observation, ["kg", ""], [(), ("K",)])

    with pytest.raises(ec.InputError, match="output 'b': it hardly follows the model"):
        fitted(i)
    assert fitted(i + x).values == pytest.approx([2.0, 2.0], rel=0.01)
    weak = fitted(i + 0.1 * x)
    assert weak.values[1] == pytest.approx(20.0, abs=3 * weak.std[1])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda t, o: drive_gains(t.base, o, o), "belong together"),
        (
            lambda t, o: drive_gains(t.base, o, o, Payload.of("link3", LOAD)),
            "loaded_rows",
        ),
        (lambda t, o: drive_gains(t.base, o, known={"Kt9": 1.0}), "Kt9"),
        (lambda t, o: drive_gains(t.load, o), "no drive gains"),
        (lambda t, _: Payload.of("link9", LOAD).base(t.base), "no body 'link9'"),
        (lambda *_: Payload("link3", {"xx": 1.0}), "did you mean"),
        (lambda *_: Payload("link3", {"M": np.nan}), "to a number"),
        (lambda *_: Payload("link3", {}), "weigh it"),
        (lambda *_: Payload.of("link3", [1.0]), "10 standard"),
    ],
)
def test_wrong_arguments_are_refused(three: Truth, call: object, message: str) -> None:
    samples = with_zeros(three.base, three.run(5, 0.01, loaded=False, count=80))
    observation = ModelRows.of(three.base, [samples]).observation()
    with pytest.raises(ec.InputError, match=message):
        call(three, observation)  # type: ignore[operator]


def test_rows_of_other_outputs_or_times_do_not_join() -> None:
    W = np.ones((5, 1, 1))
    one = ArrayRows.of(W, W[..., 0], parameters=["a"])
    with pytest.raises(ec.InputError, match="different parameters"):
        JoinedRows(one, one)
    late = ArrayRows.of(W, W[..., 0], parameters=["b"], times=np.arange(5.0))
    with pytest.raises(ec.InputError, match="different times"):
        list(JoinedRows(one, late).blocks())


# -- from files -------------------------------------------------------------------------------------------------------


def written(samples: Samples, path: Path) -> Path:
    """A log of positions and currents."""
    t = np.arange(len(samples)) / samples.rate
    columns = {"t": t, **{f"q{k + 1}": q for k, q in enumerate(samples.q.T)}}
    columns |= {
        f"i{k + 1}": current for k, current in enumerate(samples.inputs.values())
    }
    np.savez(path, **columns)
    return path


def test_gains_from_logs(three: Truth, tmp_path: Path) -> None:
    names = three.base.mechanism.velocities
    columns = ColumnMap(
        Channel("t"),
        positions={name: Channel(f"q{k}") for k, name in enumerate(names, start=1)},
        inputs={name: Channel(f"i{k}") for k, name in enumerate(names, start=1)},
    )
    setup = Setup("elbow.yaml", three.base.mechanism, (columns,))
    free, carrying = (
        written(
            three.run(seed, 1e-3, loaded=loaded, count=4000),
            tmp_path / f"run{seed}.npz",
        )
        for seed, loaded in ((1, False), (2, True))
    )
    found = ec.gains_from_logs(
        setup, [free], [carrying], ec.Payload("link3", {"M": LOAD[9]})
    )
    assert found.drives == gain_names(three.base)
    np.testing.assert_allclose(found.gains, three.gains, rtol=0.02)
    with pytest.raises(ec.InputError, match="give both or neither"):
        ec.gains_from_logs(setup, [free], [carrying])
    with pytest.raises(ec.InputError, match=r"common factor|ratios"):
        ec.gains_from_logs(setup, [free])


@pytest.mark.parametrize(
    ("robot", "wrong", "factor"),
    [("cart_pole", "pole", 7.0), ("scara", "forearm", 50.0)],
)
def test_one_output_of_few_contradicts_the_others(
    robot: str, wrong: str, factor: float
) -> None:
    """Two outputs are enough, and outputs that share nothing with the others are left out."""
    base = ec.base_parameters(ec.load(EXAMPLES / f"{robot}.yaml"))
    rng, names = (
        np.random.default_rng(3),
        [output.name for output in base.mechanism.outputs],
    )
    q, qd, qdd = rng.normal(size=(3, 400, len(names)))
    y = base.predict(q, qd, qdd, base.values(rng.uniform(0.5, 2, len(base.parameters))))
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)

    def judged(values: np.ndarray) -> tuple[dict[str, float], list[str]]:
        states = States.of(
            [Samples("", 0.0, 100.0, q, qd, qdd, values)],
            np.inf,
            base,
            np.zeros(base.rank),
        )
        judge = Judge(
            base,
            states,
            Readings(base, states, ColumnMap(), velocities=True),
            doubtful=False,
        )
        apart = {
            some.places[0]: 1 / some.size
            for some in judge.run()
            if some.kind is Kind.GAIN
        }
        return apart, judge.untested

    assert judged(y) == ({}, [])
    found, untested = judged(y / np.where(np.array(names) == wrong, factor, 1.0))
    assert found == {wrong: pytest.approx(factor, rel=0.1)}
    assert not untested
    if robot == "scara":  # an output that has nothing to do with the motion
        rows = base.regressor(q, qd, qdd)[:, names.index(wrong)]
        noise = rng.normal(size=len(y))
        y[:, names.index(wrong)] = noise - rows @ np.linalg.lstsq(rows, noise)[0]
        found, untested = judged(y)
        assert wrong not in found
        assert f"'{wrong}'" in untested[0]


@pytest.mark.slow
def test_currents_that_are_given_as_torques_contradict_each_other(
    tmp_path: Path,
) -> None:
    """Drives of different gains: each would need inertias of its own."""
    system, constants = SYSTEMS["arm"], np.array([3.0, 2.5, 1.2, 0.5, 0.3])
    motion = motion_of(system)
    setup = system.load(tmp_path).with_settings(physical=False)
    log = system.log(
        replace(motion, y=motion.y / constants), tmp_path / "run", setup.mechanism
    )
    result = ec.identify(setup, [log])
    (found,) = (f for f in result.findings if f.kind == "gains")
    assert "outputs are in units of their own" in result.verdict.split(": ", 1)[1]
    assert any(
        "outputs are in units of their own" in reason for reason in result.reasons
    )
    factors = dict(re.findall(r"(j\d): ([\d.]+)", found.text))
    assert {"j1", "j2", "j4", "j5"} == {*factors}
    np.testing.assert_allclose(
        [float(f) for f in factors.values()], (constants / 1.2)[[0, 1, 3, 4]], rtol=0.15
    )
    assert "{type: drive_gain, at: all}" in found.text
