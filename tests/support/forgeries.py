"""Forged and mutated saved sets: none is the set that it claims to be, unless it can be derived from its own model."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from math import prod
from typing import Any

from echelon.algebra.exact.rational import RationalFunction
from echelon.base.saved.saved import from_json, to_dict, verify
from echelon.shared.conventions import PARAMETERS

Document = dict[str, Any]
Forgery = Callable[[Document, random.Random], object]


def _row(data: Document, rng: random.Random) -> dict[str, Any]:
    return rng.choice([row for row in data["base"] if len(row["terms"]) > 1])


def _term(data: Document, rng: random.Random) -> dict[str, Any]:
    row = _row(data, rng)
    return rng.choice([t for t in row["terms"] if t["parameter"] != row["name"]])


def _prime_aware(data: Document, rng: random.Random) -> None:
    """Zero modulo all primes that the certificate names or its seed leads to; the rest of the set agrees with it."""
    model = from_json(json.dumps(data))
    rows = [dict(row) for row in model.matrix.rows]
    i = rng.choice([k for k, row in enumerate(rows) if len(row) > 1])
    column = rng.choice([c for c in rows[i] if c != model.matrix.pivots[i]])
    primes = [
        *model.certificate.identity_primes,
        *verify(model).identity_primes,
        model.certificate.minor_prime,
    ]
    size = 10 ** (sum(len(str(p)) for p in primes) + rng.randrange(30))
    rows[i][column] = rows[i][column] + RationalFunction(
        Fraction(prod(primes) * rng.randrange(1, 10), size)
    )
    data.update(to_dict(replace(model, matrix=replace(model.matrix, rows=tuple(rows)))))


def _scale(data: Document, rng: random.Random) -> None:
    term = _term(data, rng)
    term["coefficient"] = (
        f"({term['coefficient']})*{rng.choice(['-1', '2', '1/3', '1.000000000000000001'])}"
    )


def _swap_columns(data: Document, rng: random.Random) -> None:
    """Two parameters change places in the rows."""
    a, b = rng.sample(
        sorted({t["parameter"] for row in data["base"] for t in row["terms"]}), 2
    )
    change = {a: b, b: a}
    for row in data["base"]:
        row["name"] = change.get(row["name"], row["name"])
        for term in row["terms"]:
            term["parameter"] = change.get(term["parameter"], term["parameter"])


def _drop_row(data: Document, rng: random.Random) -> None:
    """A row is dropped, and all counts and classes follow."""
    rows = data["base"]
    rows.pop(rng.randrange(len(rows)))
    data["rank"] = data["certificate"]["rank"] = len(rows)
    seen = {t["parameter"]: len(row["terms"]) for row in rows for t in row["terms"]}
    classes: dict[str, list[str]] = {}
    for name in data["parameters"]:
        kind = {0: "unidentifiable", 1: "identifiable alone"}.get(
            seen.get(name, 0), "identifiable in combination"
        )
        classes.setdefault(kind, []).append(name)
    data["classification"] = classes


def _add_row(data: Document, rng: random.Random) -> None:
    """A parameter without a row of its own gets one."""
    name = rng.choice(
        sorted({*data["parameters"]} - {row["name"] for row in data["base"]})
    )
    row = {
        "name": name,
        "unit": "kg",
        "expression": name,
        "terms": [{"parameter": name, "coefficient": "1"}],
    }
    data["base"].insert(rng.randrange(len(data["base"]) + 1), row)
    data["rank"] = data["certificate"]["rank"] = len(data["base"])


def _pivot(data: Document, rng: random.Random) -> None:
    row = _row(data, rng)
    row["name"] = rng.choice(
        [t["parameter"] for t in row["terms"] if t["parameter"] != row["name"]]
    )


def _order(data: Document, rng: random.Random) -> None:
    """The representative of a row goes behind another of its parameters."""
    row, order = _row(data, rng), data["order"]
    order.remove(row["name"])
    order.append(row["name"])


def _expression(data: Document, rng: random.Random) -> None:
    row = rng.choice(data["base"])
    row["expression"] += rng.choice([" + 7·", " − ", " + 2²·"]) + rng.choice(
        data["parameters"]
    )
    data["echelon"] = rng.choice(["0.0.9", data["echelon"], "99"])


def _expression_hidden(data: Document, rng: random.Random) -> None:
    """Hides text in an expression that a sloppy reader would skip."""
    row = rng.choice(data["base"])
    row["expression"] += rng.choice(
        [" # + 7·M1", "\n", "; 1", " + M1 if 0 else 0", " + 0x1", "·1_0", " + ０"]
    )
    data["echelon"] = "0.0.9"


def _value(data: Document, rng: random.Random) -> None:
    term = _term(data, rng)
    term["value"] = rng.choice([None, 0.5, 1e300]) if term["value"] != 0.5 else 7.0


def _value_nearly(data: Document, rng: random.Random) -> None:
    """A number that looks right."""
    term = rng.choice(
        [t for row in data["base"] for t in row["terms"] if t["value"] is not None]
    )
    term["value"] *= 1 + 1e-6


def _symbol(data: Document, rng: random.Random) -> None:
    """Another value of a symbol that coefficients hold."""
    shown = " ".join(t["coefficient"] for row in data["base"] for t in row["terms"])
    used = [
        s
        for s, v in data["model"].get("symbols", {}).items()
        if isinstance(v, str) and s in shown
    ]
    data["model"]["symbols"][rng.choice(used)] = rng.choice(["0.7071", "12", "1/3"])


def _mask(data: Document, rng: random.Random) -> None:
    body = rng.choice(data["model"]["bodies"])
    body.pop("parameters", None)
    body.update(
        rng.choice(
            [
                {"massless": True},
                {"parameters": ["ZZ", "M"]},
                {"parameters": ["M", "MX"]},
            ]
        )
    )


def _unit(data: Document, rng: random.Random) -> None:
    rng.choice(data["base"])["unit"] = rng.choice(["g", "", "kg·m³"])


def _class(data: Document, rng: random.Random) -> None:
    kinds = sorted(data["classification"])
    one = rng.choice(kinds)
    moved = data["classification"][one].pop(
        rng.randrange(len(data["classification"][one]))
    )
    other = rng.choice(
        [
            k
            for k in (
                "unidentifiable",
                "identifiable alone",
                "identifiable in combination",
            )
            if k != one
        ]
    )
    data["classification"].setdefault(other, []).append(moved)


def _count(data: Document, rng: random.Random) -> None:
    rng.choice([data, data["certificate"]])["rank"] += rng.choice([-1, 1, 100])


def _list(data: Document, rng: random.Random) -> None:
    key = rng.choice(["outputs", "parameters", "order"])
    rng.choice(
        [
            data[key].pop,
            lambda: data[key].append(data[key][0]),
            lambda: data[key].append("nobody"),
        ]
    )()


def _rename(data: Document, rng: random.Random) -> None:
    key = rng.choice(["outputs", "parameters"])
    data[key][rng.randrange(len(data[key]))] += rng.choice(["'", "0", " "])


def _repeat(data: Document, rng: random.Random) -> None:
    rows = data["base"]
    place = rng.randrange(len(rows))
    rows.insert(place, json.loads(json.dumps(rows[place])))
    data["rank"] = data["certificate"]["rank"] = len(rows)


def _shape(data: Document, rng: random.Random) -> None:
    """Anything else in place of anything."""
    here: Any = data
    while True:
        keys = list(here) if isinstance(here, dict) else list(range(len(here)))
        key = rng.choice(keys)
        if isinstance(here[key], dict | list) and here[key] and rng.random() < 0.8:
            here = here[key]
            continue
        here[key] = rng.choice(
            [[], {}, None, "x", -3, 1e308, True, "9" * 5000, "(" * 400, {"a": [[]]}]
        )
        return


def _missing(data: Document, rng: random.Random) -> None:
    del data[
        rng.choice(
            [
                "base",
                "model",
                "order",
                "rank",
                "certificate",
                "classification",
                "parameters",
                "outputs",
            ]
        )
    ]


def _zero(data: Document, rng: random.Random) -> None:
    """A term of zero, or one divided by zero."""
    row = rng.choice(data["base"])
    row["terms"].append(
        {
            "parameter": rng.choice(data["parameters"]),
            "coefficient": rng.choice(["0", "1 - 1"]),
        }
    )
    if rng.random() < 0.5:
        row["terms"][-1] |= {
            "coefficient": "1",
            "denominator": rng.choice(["0", "2 - 2"]),
        }


def _frame(data: Document, rng: random.Random) -> None:
    """A rotation that is none."""
    body = rng.choice(data["model"]["bodies"])
    turned = rng.choice(
        [
            [["1", "0", "0"], ["0", "1", "0"], ["0", "0", "-1"]],
            [["2", "0", "0"]] + [["0", "1", "0"]] * 2,
        ]
    )
    body["joint"]["steps"].insert(0, {"rotation": turned})


def _joint(data: Document, rng: random.Random) -> None:
    """Another robot."""
    steps = [
        s
        for body in data["model"]["bodies"]
        for s in body["joint"]["steps"]
        if s.get("motion") != "ball"
    ]
    moving = rng.choice([s for s in steps if "motion" in s])
    change = (
        {"axis": rng.choice(["x", "y", "z"])}
        if rng.random() < 0.5
        else {"motion": "translation"}
    )
    moving.update(change)


def _shift(data: Document, rng: random.Random) -> None:
    """A body elsewhere."""
    rng.choice(data["model"]["bodies"])["joint"]["steps"].insert(
        0, {"xyz": ["0.125", "0.0625", "1.5"]}
    )


def _gravity(data: Document, rng: random.Random) -> None:
    data["model"]["gravity"] = rng.choice(
        ["none", "generic", ["1.0", "2.0", "3.0"], ["0.0", "0.0", "0.0"]]
    )


def _setup(data: Document, rng: random.Random) -> None:
    """Other effects, couplings, drives or outputs, where there are any; else another parent."""
    model = data["model"]
    found: list[Callable[[], object]] = [
        lambda: model["bodies"][-1].pop("parent", None)
    ]
    if "effects" in model:
        act = rng.choice(model["effects"])["acts"][0]
        found += [
            lambda: act.update(term="qdd"),
            lambda: act.update(side="joint"),
            lambda: model["effects"].pop(),
        ]
    if "couplings" in model:
        found.append(
            lambda: next(iter(model["couplings"][0].values()))["terms"].update(
                left="3.0"
            )
        )
    if "actuators" in model:
        found.append(
            lambda: next(iter(model["actuators"].values()))["terms"].update(j1="1.0")
        )
    if "outputs" in model:
        found.append(lambda: model["outputs"].pop())
    rng.choice(found)()


def _special(data: Document, rng: random.Random) -> None:
    """Changes the ranks at the stated and at general values."""
    change = rng.choice([-1, 1, 3])
    ranks = ("rank", "generic_rank")[:: -1 if data["generic"] else 1]
    own, other = data["rank"] + change, data["rank"] + rng.choice([0, change])
    data["special"] = {
        **dict(zip(ranks, (own, other), strict=True)),
        "relations": ["a = 0"],
    }


def _generic(data: Document, rng: random.Random) -> None:
    """For general values instead of the stated ones, or the other way round; perhaps nothing about special ones."""
    data["generic"], data["special"] = (
        not data["generic"],
        rng.choice([None, data["special"]]),
    )


LOOK_ALIKES = ("2 + M1", "1·M2", "1-M2", "1\u200b", "\u202e1", "１", "\u0430", "\u0391")


def _label(data: Document, rng: random.Random) -> None:
    """A label that reads as a formula or as another one, everywhere but in the expressions."""
    old, new = rng.choice(data["model"]["bodies"])["label"], rng.choice(LOOK_ALIKES)
    changed = {kind + old: kind + new for kind in PARAMETERS}
    for body in data["model"]["bodies"]:
        if body["label"] == old:
            body["label"] = new
    for key in ("parameters", "order"):
        data[key] = [changed.get(name, name) for name in data[key]]
    for row in data["base"]:
        row["name"] = changed.get(row["name"], row["name"])
        for term in row["terms"]:
            term["parameter"] = changed.get(term["parameter"], term["parameter"])


CERTIFICATE: dict[str, Any] = {
    "minor_prime": [4, 2147483647, -1],
    "minor_states": [0, -5],
    "degree": [0, 10**40],
    "log10_error": [-1e9, 0.0],
    "at_values": [True, False],
    "regions": [10**6],
    "regions_note": ["all regions, proved"],
    "numbers": [3],
    "log10_residual": [-99.0],
    "ball_states": [9],
    "columns": [{}, {"minor": 10**6}],
    "unchecked": [["nothing else"]],
    "other_values": [9],
    "rounding": [0.01],
    "seed": [1, 7],
    "identity_primes": [[], ["4"], ["170141183460469231731687303715884105727"]],
}


def _certificate(data: Document, rng: random.Random) -> None:
    """Evidence that was not found."""
    key = rng.choice(sorted(CERTIFICATE))
    data["certificate"][key] = rng.choice(
        [v for v in CERTIFICATE[key] if v != data["certificate"][key]]
    )


FORGERIES: dict[str, Forgery] = {
    name.removeprefix("_"): forge
    for name, forge in list(globals().items())
    if name.startswith("_")
    and not name.startswith("__")
    and name not in ("_row", "_term")
}
"""Every kind by name."""


@dataclass(frozen=True)
class Forged:
    """The text of a forged set, of which kind it is and what it was made of."""

    kind: str
    name: str
    text: str


def forged(documents: dict[str, str], count: int, seed: int) -> Iterator[Forged]:
    """Forgeries of the texts of saved sets, of all kinds in turn.

    Parameters
    ----------
    documents : dict of str to str
    count : int
    seed : int
    """
    rng, kinds = random.Random(seed), sorted(FORGERIES)
    made = 0
    while made < count:
        kind, name = kinds[made % len(kinds)], rng.choice(sorted(documents))
        data = json.loads(documents[name])
        try:
            FORGERIES[kind](data, rng)
        except IndexError:
            continue  # this set holds nothing of the kind
        if data != json.loads(documents[name]):
            made += 1
            yield Forged(kind, name, json.dumps(data))
