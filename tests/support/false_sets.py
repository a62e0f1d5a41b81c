"""False sets that are made as `derive` would make true ones: of every robot, in every way, with a new certificate.

Robots are trees, couplings, loops, sensors, signs and functions, drawn at random; ways are fewer or more
representatives, general sets passed for those of special values, changed coefficients, columns called numbers, and
flags of the model.  A set that is accepted has to be the honest one.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache

import numpy as np

import echelon as ec
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.certificate import certify
from echelon.base.derive import model_at_stated_values
from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.base.saved.saved import from_json, to_json
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.formats.snapping import ReadingOptions
from echelon.robot.stated import all_symbols, value_texts
from support.descriptions import read_description

ONE = RationalFunction(1)

ANGLES = ("0", "pi/2", "pi", "-pi", "pi/7", "3*pi/7", "0.3", "pi/6")
LENGTHS = ("0", "0.25", "0.25", "0.5", "0.35")
TERMS = (
    "sign(qd)",
    "sign(qd - 50)",
    "sign(qd - 1e-6) + sign(qd + 1e-6)",
    "abs(qd)*qd",
    "exp(-qd^2)*qd",
    "sign(qd) + exp(-1000 - qd^2)",
    "qd + 1e-80*q",
    "1e60*q",
    "qd",
    "1",
    "q",
    "sin(q)",
)


def _effects(rng: random.Random, joints: list[str], most: int) -> str:
    count = rng.randrange(most + 1)
    chosen = [(f"P{k}", rng.choice(joints), rng.choice(TERMS)) for k in range(count)]
    rows = [
        f"{{parameter: {name}, unit: N·m, acts: [{{at: {at}, term: '{term}'}}]}}"
        for name, at, term in chosen
    ]
    return f"\neffects: [{', '.join(rows)}]" if rows else ""


def _arm(rng: random.Random) -> str:
    """A serial arm whose twists and lengths are symbols, special at their values."""
    joints = rng.randrange(2, 5)
    names = [f"j{k + 1}" for k in range(joints)]
    symbols = [
        f"alpha{k}: {rng.choice(ANGLES)}, a{k}: {rng.choice(LENGTHS)}"
        for k in range(1, joints)
    ]
    rows = ["{joint: revolute}"]
    rows += [
        f"{{joint: {rng.choice(['revolute', 'revolute', 'prismatic'])}, alpha: alpha{k}, a: a{k}}}"
        for k in range(1, joints)
    ]
    text = f"symbols: {{{', '.join(symbols)}}}\nmodified_dh: [{', '.join(rows)}]"
    if rng.random() < 0.3:
        text += f"\ncouplings: [{{{names[-1]}: {rng.choice(['2', '-1', '1/2'])}*{names[0]}}}]"
        names = names[:-1]
    elif rng.random() < 0.4:
        text += f"\noutputs: [{{wrench: base}}, {{joint: {names[-1]}}}]"
    return text + _effects(rng, names, 3)


def _parallelogram(rng: random.Random) -> str:
    """A planar four-bar whose lengths are symbols, mostly with pairwise equal values."""
    long, short = rng.choice([("0.4", "0.15"), ("0.5", "0.2"), ("0.3", "0.3")])
    other = rng.choice([long, long, "0.42"])
    pose = "crank: 1.0, coupler: -1.0, rocker: 1.0"
    return f"""symbols: {{l1: {long}, l2: {short}, l3: {other}, l4: {short}}}
gravity: {rng.choice(["[0, -9.81, 0]", "none"])}
bodies:
  - {{name: crank, joint: {{type: revolute, axis: z}}}}
  - {{name: coupler, parent: crank, joint: {{type: revolute, axis: z, origin: {{xyz: [l2, 0, 0]}}}}}}
  - {{name: rocker, joint: {{type: revolute, axis: z, origin: {{xyz: [l1, 0, 0]}}}}}}
loops:
  - {{joint: revolute, connects: [coupler, rocker], at: {{xyz: [l3, 0, 0]}}, on_second: {{xyz: [l4, 0, 0]}}, axis: z}}
assembly: {{{pose}}}""" + _effects(rng, ["crank"], 2)


def _four_bar(rng: random.Random) -> str:
    """A planar four-bar in numbers."""
    crank = rng.choice(["0.3", "0.25"])
    return f"""gravity: [0, -9.81, 0]
bodies:
  - {{name: crank, joint: {{type: revolute, axis: z}}}}
  - {{name: coupler, parent: crank, joint: {{type: revolute, axis: z, origin: {{xyz: [0, {crank}, 0]}}}}}}
  - {{name: rocker, joint: {{type: revolute, axis: z, origin: {{xyz: [0.7, 0, 0]}}}}}}
loops:
  - joint: revolute
    connects: [coupler, rocker]
    at: {{xyz: [0.6, 0.2, 0]}}
    on_second: {{xyz: [-0.1, 0.5, 0]}}
    axis: z
""" + _effects(rng, ["crank"], 2)


ROBOTS: dict[str, Callable[[random.Random], str]] = {
    "arm": _arm,
    "parallelogram": _parallelogram,
    "four-bar": _four_bar,
}


@dataclass(frozen=True)
class Honest:
    """A robot with its true sets."""

    text: str
    own: ec.BaseModel  # at the stated values
    general: ec.BaseModel | None  # for general values; None where it cannot be derived


@cache
def honest(text: str) -> Honest | None:
    """The true sets of a description; None if it is refused or doubted."""
    try:
        mechanism = read_description(
            f"echelon: 1\nname: robot\n{text}".encode(), "robot.yaml", ReadingOptions()
        )
        own = ec.base_parameters(mechanism)
        general = (
            ec.base_parameters(mechanism, generic=True) if mechanism.symbols else None
        )
    except (ec.EchelonError, Warning):
        return None
    return None if own.reading.doubt else Honest(text, own, general)


@dataclass(frozen=True)
class FalseSet:
    """A set that may be false."""

    kind: str
    model: ec.BaseModel
    truth: Honest


Attack = Callable[[Honest, random.Random], ec.BaseModel | None]


def _made(
    model: ec.BaseModel,
    rows: Mapping[int, Mapping[int, RationalFunction]],
    numbers: StatedNumbers | None,
) -> ec.BaseModel:
    """A set with other rows, by their pivots, in the column order of the honest one."""
    pivots = tuple(column for column in model.matrix.order if column in rows)
    matrix = replace(
        model.matrix,
        pivots=pivots,
        rows=tuple(dict(rows[p]) for p in pivots),
        numbers=numbers,
    )
    return replace(model, matrix=matrix)


def _rows(matrix: BaseMatrix) -> dict[int, dict[int, RationalFunction]]:
    return {
        pivot: dict(row) for pivot, row in zip(matrix.pivots, matrix.rows, strict=True)
    }


def _numbers(
    model: ec.BaseModel, columns: list[int], rng: random.Random
) -> StatedNumbers:
    """Some columns called numbers, exact or not."""
    at = value_texts(model.mechanism, all_symbols(model.mechanism))
    return StatedNumbers(tuple(sorted(columns)), at, rng.choice([0.0, 1e-40]), False)


def fewer(truth: Honest, rng: random.Random) -> ec.BaseModel | None:
    """Representatives are dropped, and their columns are zero, numbers, or called so."""
    model = truth.own
    if model.rank < 2:
        return None
    dropped = set(rng.sample(model.matrix.pivots, rng.randrange(1, model.rank)))
    rows = {
        p: {c: v for c, v in row.items() if c not in dropped}
        for p, row in _rows(model.matrix).items()
        if p not in dropped
    }
    others = [c for c in range(len(model.parameters)) if c not in rows]
    if rng.random() < 0.5:
        rows = {p: {p: ONE} for p in rows}
    called = rng.choice([None, [], others, list(dropped)])
    return _made(model, rows, None if called is None else _numbers(model, called, rng))


def one_side(truth: Honest, rng: random.Random) -> ec.BaseModel | None:
    """A representative is called a number times another one, as in one region of signs or to many digits."""
    model = truth.own
    if model.rank < 2:
        return None
    dropped, kept = rng.sample(model.matrix.pivots[-4:], 2)
    rows = {
        p: {c: v for c, v in row.items() if c != dropped}
        for p, row in _rows(model.matrix).items()
        if p != dropped
    }
    if model.matrix.order.index(kept) > model.matrix.order.index(dropped):
        return None
    rows[kept][dropped] = RationalFunction(Fraction(rng.choice([1, -1, 2])))
    return _made(model, rows, _numbers(model, [dropped], rng))


def general_for_own(truth: Honest, rng: random.Random) -> ec.BaseModel | None:  # noqa: ARG001
    """The general set is passed for that at the stated values."""
    return (
        None
        if truth.general is None
        else replace(truth.general, generic=False, special=None)
    )


def silent_general(truth: Honest, rng: random.Random) -> ec.BaseModel | None:  # noqa: ARG001
    """The general set does not say what the stated values change."""
    return None if truth.general is None else replace(truth.general, special=None)


def more(truth: Honest, rng: random.Random) -> ec.BaseModel | None:
    """A dependent column becomes a representative."""
    model = truth.own
    dependent = [
        c for c in range(len(model.parameters)) if c not in model.matrix.pivots
    ]
    if not dependent:
        return None
    column = rng.choice(dependent)
    rows = {
        p: {c: v for c, v in row.items() if c != column}
        for p, row in _rows(model.matrix).items()
    }
    numbers = rng.choice([model.matrix.numbers, _numbers(model, [], rng)])
    return _made(model, rows | {column: {column: ONE}}, numbers)


def other_coefficient(truth: Honest, rng: random.Random) -> ec.BaseModel | None:
    """A coefficient is another number, in a column that is called one or not."""
    model = truth.own
    places = [(p, c) for p, row in _rows(model.matrix).items() for c in row if c != p]
    if not places:
        return None
    pivot, column = rng.choice(places)
    rows = _rows(model.matrix)
    rows[pivot][column] = RationalFunction(
        rng.choice([Fraction(7), Fraction(-1), Fraction(1, 10**25)])
    )
    called = (
        [column]
        if all(not rows[p][column].symbols() for p in rows if column in rows[p])
        else []
    )
    numbers = (
        model.matrix.numbers if rng.random() < 0.3 else _numbers(model, called, rng)
    )
    return _made(model, rows, numbers)


def all_numbers(truth: Honest, rng: random.Random) -> ec.BaseModel | None:
    """All columns are called numbers, with one coefficient that may be another."""
    model = truth.own
    values = model.B_float()
    rows = _rows(model.matrix)
    for i, pivot in enumerate(model.matrix.pivots):
        for column in rows[pivot]:
            rows[pivot][column] = RationalFunction(
                Fraction(repr(float(values[i, column])))
            )
    places = [(p, c) for p in rows for c in rows[p] if c != p]
    if places and rng.random() < 0.8:
        pivot, column = rng.choice(places)
        rows[pivot][column] = RationalFunction(Fraction(rng.choice([7, -3])))
    others = [c for c in range(len(model.parameters)) if c not in rows]
    return _made(
        model,
        {p: {c: v for c, v in row.items() if v} for p, row in rows.items()},
        _numbers(model, others, rng),
    )


ATTACKS: tuple[Attack, ...] = (
    fewer,
    one_side,
    general_for_own,
    silent_general,
    more,
    other_coefficient,
    all_numbers,
)


def false_sets(count: int, seed: int) -> Iterator[FalseSet]:
    """Sets that may be false, of all robots and in all ways in turn.

    Parameters
    ----------
    count : int
    seed : int
    """
    rng, made = random.Random(seed), 0
    while made < count:
        name = rng.choice(sorted(ROBOTS))
        truth = honest(ROBOTS[name](rng))
        if truth is None:
            continue
        for attack in ATTACKS:
            model = attack(truth, rng)
            if model is None or made >= count:
                continue
            made += 1
            yield FalseSet(attack.__name__, model, truth)


def is_accepted(false: FalseSet) -> bool:
    """Whether a set passes its own check, is written, read back and verified."""
    model = false.model
    stated = None if model.generic else model_at_stated_values(model.mechanism)
    try:
        certificate = certify(
            virtual_power_form(model.mechanism), model.matrix, model.seed, stated
        )
        ec.verify(from_json(to_json(replace(model, certificate=certificate))))
    except (ec.EchelonError, json.JSONDecodeError):
        return False
    return not certificate.unchecked


def is_true(false: FalseSet) -> bool:
    """Whether a set is the honest one: as many base parameters, and the same coefficients at the stated values."""
    model, truth = false.model, false.truth
    honest_one = truth.general if model.generic else truth.own
    if (
        honest_one is None
        or model.rank != honest_one.rank
        or model.matrix.pivots != honest_one.matrix.pivots
    ):
        return False
    if model.generic and model.special != honest_one.special:
        return False
    return bool(
        np.allclose(model.B_float(), honest_one.B_float(), rtol=1e-12, atol=1e-12)
    )
