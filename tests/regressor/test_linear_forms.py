"""The energy form against energies worked out by hand, term by term.

What is proved block by block against the null vectors of the whole, and what becomes of it in a certificate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import echelon as ec
from echelon.algebra.exact.field import PrimeField, null_vectors
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.certificate import certify
from echelon.base.matrix import BaseMatrix
from echelon.dynamics import linear_forms
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import (
    blocks_of,
    energy_changes,
    energy_form,
    virtual_power_form,
)
from echelon.robot.effect import Side, ready_made
from echelon.robot.joint import floating_motions, rotation, translation
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import CertificateError
from support import textbook_arms as arms
from support.random_mechanisms import mechanisms
from support.selection import examples, slow_unless

G = np.array([1.5, -2.0, -9.81])


def energies(mechanism: Mechanism, q: list[float], qd: list[float]) -> dict[str, float]:
    """Coefficient of every standard parameter at one state, and of the constant."""
    state = (np.array([x]) for x in (q, qd, np.zeros_like(qd)))
    (row,) = evaluate_floats(energy_form(mechanism), mechanism, *state)[0]
    return dict(zip(("1", *mechanism.parameters), row, strict=True))


def slider() -> Mechanism:
    """A body that slides along the base's y axis from the point (0.3, 0.5, −0.2), with its axes turned about z."""
    steps = (
        arms.place("3/10 1/2 -1/5"),
        translation("y", 1),
        arms.place("0 0 0", "0 0 pi/2"),
    )
    return arms.tree(
        "slider", arms.body(1, 0, "prismatic", *steps), gravity="3/2 -2 -9.81"
    )


@pytest.mark.parametrize("y", [0.0, 0.7, -1.9])
def test_potential_energy_of_a_mass_is_minus_gravity_times_its_place(y: float) -> None:
    found = energies(slider(), [y], [0.0])
    assert found["1"] == 1
    assert found["M1"] == pytest.approx(-G @ [0.3, 0.5 + y, -0.2])
    # the body's x axis is the base's y axis
    assert [found[f"M{c}1"] for c in "XYZ"] == pytest.approx([-G[1], G[0], -G[2]])


def test_kinetic_energy_of_a_mass_is_half_its_speed_squared() -> None:
    still, moving = energies(slider(), [0.4], [0.0]), energies(slider(), [0.4], [3.0])
    gained = {name: moving[name] - still[name] for name in moving}
    assert gained == pytest.approx({**dict.fromkeys(gained, 0.0), "M1": 4.5})


def test_pendulum_rises_by_the_height_of_its_mass() -> None:
    """A mass at distance l on a pendulum about y has height −l cos q; carried by the body's own M or by MX."""
    place = arms.place("0 0 -1/2")
    first = arms.body(1, 0, "revolute", rotation("q", 1))
    second = arms.body(2, 1, "fixed", place)
    angle, rate, length = 0.6, 1.7, 0.5
    found = energies(
        arms.tree("pendulum", first, second, gravity="0 0 -9.81"), [angle], [rate]
    )
    height = -length * np.cos(angle)
    assert found["M2"] == pytest.approx(9.81 * height + (length * rate) ** 2 / 2)
    assert found["MZ1"] == pytest.approx(9.81 * np.cos(angle))
    assert found["MX1"] == pytest.approx(-9.81 * np.sin(angle))
    assert found["YY1"] == pytest.approx(rate**2 / 2)
    assert found["M1"] == found["XX1"] == found["XY1"] == 0


@pytest.fixture(autouse=True)
def small_models_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linear_forms, "FEW_COLUMNS", -1)


def chain(joints: int) -> Mechanism:
    """Skew axes on a floating base."""
    base, place = (
        arms.body(1, 0, "floating", *floating_motions("base")),
        arms.place("a 0 b", "pi/3 pi/4 0"),
    )
    turns = (
        arms.body(k, k - 1, "revolute", place, rotation(f"q{k}"))
        for k in range(2, joints + 1)
    )
    return arms.tree("chain", base, *turns)


def in_null_vectors(mechanism: Mechanism) -> tuple[set[int], set[int]]:
    """Columns that occur in any null vector of X, and columns that X has."""
    forms = virtual_power_form(mechanism)
    rng = np.random.default_rng(3)
    field = PrimeField.random(rng)
    sampler = forms.sampler()
    geometry = {s: field.draw(rng, (1,)) for s in sampler.symbols}
    matrix = forms.stacked(sampler.evaluate(field, rng, forms.shape[1] + 8, geometry))[
        0
    ]
    vectors = null_vectors(matrix, field)
    return {c for v in vectors for c, entry in enumerate(v) if entry}, {
        c for _, c in forms.entries
    }


@examples(25)
@given(mechanisms(5))
def test_no_column_of_a_null_vector_is_settled(mechanism: Mechanism) -> None:
    dependent, seen = in_null_vectors(mechanism)
    rng = np.random.default_rng(4)
    powers = virtual_power_form(mechanism).blocks
    assert powers is not None
    for rows in (energy_changes(mechanism), powers):
        for columns in (seen, set(range(len(mechanism.parameters)))):
            settled = rows.independent(columns, PrimeField.random(rng), rng)
            assert settled <= columns - dependent


def test_all_of_a_floating_chain_is_settled() -> None:
    """But the base's ten parameters take six coordinates, which are one block."""
    mechanism = chain(5)
    pivots = ec.base_parameters(mechanism).matrix.pivots
    rng = np.random.default_rng(4)
    powers = virtual_power_form(mechanism).blocks
    assert powers is not None
    for rows in (energy_changes(mechanism), powers):
        assert rows.independent(pivots, PrimeField.random(rng), rng) == set(pivots)


def test_blocks_hold_what_is_tied() -> None:
    """A coupling, an actuator with friction in it and massless bodies tie joints and all that lies between them."""
    plain = arms.rx90()
    assert [b.bodies for b in blocks_of(plain)] == [(k,) for k in range(6)]
    assert [b.carried for b in blocks_of(plain)] == [(1,), (2,), (3,), (4,), (5,), ()]
    coupled = arms.tree("coupled", *plain.bodies, couplings={"q4": {"q2": "1"}})
    assert [b.bodies for b in blocks_of(coupled)] == [(0,), (1, 2, 3), (4,), (5,)]
    assert [b.coordinates for b in blocks_of(coupled)] == [
        ("q1",),
        ("q2", "q3"),
        ("q5",),
        ("q6",),
    ]
    bodies = tuple(
        replace(b, carried=()) if k in (3, 4) else b for k, b in enumerate(plain.bodies)
    )
    assert [b.bodies for b in blocks_of(replace(plain, bodies=bodies))] == [
        (0,),
        (1,),
        (2,),
        (3, 4, 5),
    ]
    friction = ready_made("viscous", "q3", Side.JOINT, "3", sliding=False)
    assert [b.effects for b in blocks_of(replace(plain, effects=friction))][2] == (0,)


def test_fingers_on_two_branches_are_one_block() -> None:
    hand = arms.body(1, 0, "revolute", rotation("q1"))
    slides = [
        arms.body(k, 1, "prismatic", arms.place("0 b c"), translation(f"f{k}", 1))
        for k in (2, 3)
    ]
    mechanism = arms.tree("hand", hand, *slides, couplings={"f3": {"f2": "-1"}})
    assert [b.bodies for b in blocks_of(mechanism)] == [(0,), (1, 2)]


# -- the certificate --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "extra", slow_unless(["M3", "YY2"], ["M3", "M9", "YY2", "MZ5"])
)
def test_a_representative_too_many_is_refused(extra: str) -> None:
    """Wherever it is: alone in its own block it looks independent of what is not there."""
    mechanism = chain(9)
    matrix = ec.base_parameters(mechanism).matrix
    column = matrix.parameters.index(extra)
    rows = {p: dict(row) for p, row in zip(matrix.pivots, matrix.rows, strict=True)}
    for row in rows.values():
        row.pop(column, None)
    rows[column] = {column: RationalFunction(1)}
    pivots = tuple(sorted(rows))
    claimed = BaseMatrix(
        matrix.parameters, pivots, tuple(rows[p] for p in pivots), matrix.order
    )
    with pytest.raises(CertificateError, match="too large"):
        certify(virtual_power_form(mechanism), claimed, seed=5)


@pytest.mark.parametrize(
    "make",
    [arms.rx90, arms.stanford, arms.massless, arms.coupled, arms.rack, arms.branched],
)
def test_the_right_set_is_certified(make: object) -> None:
    mechanism = make()  # type: ignore[operator]
    base = ec.base_parameters(mechanism)
    assert certify(virtual_power_form(mechanism), base.matrix, seed=6).rank == base.rank
