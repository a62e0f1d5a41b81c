"""Kinds of effects, read from the syntax trees of their terms; and a law of friction that the tables do not list."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import echelon as ec
from echelon.identification.logs.preparation.prepare import has_dry_friction
from echelon.identification.physics.bounds import roles
from echelon.identification.servos.servo_motion import smooth
from echelon.robot import effect
from echelon.robot.effect import (
    CONSTANTS,
    KINDS,
    Action,
    Effect,
    EffectTerm,
    Side,
    ready_made,
)
from echelon.robot.mechanism import Mechanism
from echelon.robot.term import read_term
from support.pendulum_logs import RATE, pendulum

TERMS = {
    "qd[j-1]": ("viscous", True, False),
    " qd['j-1'] ": ("viscous", True, False),
    "qd[j-2]": ("", False, False),
    "2*qd": ("", False, False),
    "sign( qd )": ("coulomb", True, True),
    "sign(q)": ("", False, False),
    "-i[current]": ("drive_gain", False, False),
    "q - i": ("servo", False, False),
    "q - i[j-1]": ("servo", False, False),
    "q - i[j-2]": ("", False, False),
    "sign(qd)*abs(i)": ("load_friction", True, True),
    "sign(qd)*abs(i[load])": ("", False, True),
    "q^2": ("cable", False, False),
    "sign(qd)*exp(-(abs(qd)/0.1)**(3/2))": ("stribeck", False, True),
    "sin(6*q)": ("ripple", False, False),
    "tanh(qd/0.1)": ("smooth_coulomb", True, True),
    "tanh(qd/(2*w))": ("smooth_coulomb", True, True),
    "tanh(10*qd)": ("", False, True),
    "qd/(0.1 + abs(qd))": ("", False, True),
    "qd[j-2]/sqrt(0.1 + qd[j-2]^2)": ("", False, True),
    "qd*abs(qd)": ("", False, False),
    "qd*sqrt(abs(qd))": ("", False, False),
    "qd + 0.1*atan(qd)": ("", False, True),
    "tanh(q)*qd": ("", False, False),
}


@pytest.mark.parametrize("term", TERMS)
def test_terms_are_read_by_their_shape(term: str) -> None:
    action = Action("j-1", Side.JOINT, term)
    assert (action.kind, action.is_positive, action.read.is_dry) == TERMS[term]


def test_rows_of_the_table_are_found_again() -> None:
    """Laws of one shape count as the first: a preload is an offset, a cable's stiffness that of a spring."""
    same = {("spring", "1"): "offset", ("cable", "q"): "spring"}
    same |= {("elastic", "1"): "offset", ("elastic", "q"): "spring"}
    same |= {("elastic", "qd"): "viscous"}
    for kind, entries in KINDS.items():
        constants = dict.fromkeys(CONSTANTS.get(kind, {}), "0.3")
        for made, entry in zip(
            ready_made(kind, "j", Side.JOINT, "1", sliding=False, constants=constants),
            entries,
            strict=False,
        ):
            (action,) = made.actions
            assert action.kind == same.get((kind, entry.term), kind)


def test_parts_of_a_text_are_replaced_and_nothing_else() -> None:
    term = read_term("0.10000000000000000001*é*qd[é] + é[é]*sign(é)")
    symbols = {q.node: "(l)" for q in term.quantities if q.at is None}
    assert term.replaced(symbols) == "0.10000000000000000001*(l)*qd[é] + é[é]*sign((l))"


def with_effect(mechanism: Mechanism, *effects: Effect) -> Mechanism:
    return replace(mechanism, effects=effects)


@pytest.mark.parametrize("term", ["2*", "qd qd", "qd # at rest"])
def test_what_is_no_expression_is_refused_at_once(term: str) -> None:
    bad = Effect("P", "N·m", (Action("j1", Side.JOINT, term),))
    with pytest.raises(ec.InputError, match="effect 'P'"):
        with_effect(pendulum().mechanism, bad)


def test_signs_become_smooth_wherever_they_stand() -> None:
    term = "sign(qd + sign(q))*2 + abs(sign((qd)))"
    acting = Effect("P", "N·m", (Action("j1", Side.JOINT, term),))
    smoothed = smooth(with_effect(pendulum().mechanism, acting), 0.5)
    assert (
        smoothed.effects[0].actions[0].term
        == "tanh((qd + tanh((q)*2))*2)*2 + abs(tanh((qd)*2))"
    )


@pytest.fixture
def arctangent(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Effect, ...]]:
    """A law that the table gets from outside: Fh atan(q̇/v), at both joints."""
    row = EffectTerm("Fh", "N·m", "N", "atan(qd/({velocity}))", positive=True)
    monkeypatch.setitem(KINDS, "arctangent", (row,))
    monkeypatch.setitem(CONSTANTS, "arctangent", {"velocity": None})
    effect._templates.cache_clear()
    places = {"j1": "1", "j2": "2"}
    made = [
        ready_made(
            "arctangent",
            at,
            Side.JOINT,
            label,
            sliding=False,
            constants={"velocity": "0.1"},
        )
        for at, label in places.items()
    ]
    yield tuple(found for effects in made for found in effects)
    monkeypatch.undo()
    effect._templates.cache_clear()


def test_a_new_law_is_friction_everywhere(arctangent: tuple[Effect, ...]) -> None:
    setup = pendulum()
    robot = with_effect(setup.mechanism, *arctangent)
    assert [action.kind for made in robot.effects for action in made.actions] == [
        "arctangent"
    ] * 2
    assert all(has_dry_friction(robot, output) for output in robot.outputs)
    columns = [robot.parameters.index(name) for name in ("Fh1", "Fh2")]
    assert set(columns) <= set(roles(robot).positive)
    base = ec.base_parameters(robot)
    assert base.rank == ec.base_parameters(setup.mechanism).rank + 2
    assert base.certificate.rank == base.rank
    assert "atan" in "".join(ec.generate(base, "c", ["inverse_dynamics"]).values())

    t = np.arange(3000) / RATE
    phases = np.random.default_rng(0).uniform(0, 7, (2, 4))
    w = 2 * np.pi * np.array([0.31, 0.57, 0.83, 1.21])
    waves = [np.multiply.outer(t, w) + phase for phase in phases]
    q = np.stack([(0.4 * np.sin(wave)).sum(axis=1) for wave in waves], axis=1)
    qd = np.stack([(0.4 * w * np.cos(wave)).sum(axis=1) for wave in waves], axis=1)
    qdd = np.stack([(-0.4 * w**2 * np.sin(wave)).sum(axis=1) for wave in waves], axis=1)
    truth = np.linspace(1, 2, base.rank)
    y = base.predict(q, qd, qdd, truth)
    log = {"t": t, "q0": q[:, 0], "q1": q[:, 1], "tau0": y[:, 0], "tau1": y[:, 1]}
    found = ec.identify(replace(setup, mechanism=robot), log)
    estimated = dict(zip(found.estimate.parameters, found.estimate.values, strict=True))
    for name in ("Fh1", "Fh2"):
        assert estimated[name] == pytest.approx(
            truth[base.pivots.index(name)], rel=0.02
        )
