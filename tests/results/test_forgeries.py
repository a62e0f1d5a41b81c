"""Forged sets are refused, by the verification and by the independent verifier, and never with a traceback."""

from __future__ import annotations

import json
from functools import cache
from operator import itemgetter
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.exact.expressions import parse
from echelon.exact.polynomial import float_generators
from echelon.exact.rational import RationalFunction
from echelon.formats.robot_file import read_description
from echelon.formats.snapping import ReadingOptions
from echelon.results.echelon_verify import judge
from echelon.results.saved import from_json, to_dict, to_json
from support.forgeries import FORGERIES, Forged, forged
from support.paths import EXAMPLES
from support.selection import one_in

SMALL = ("double_pendulum", "scara", "gripper_coupled", "furuta", "loops/parallelogram")
ALL = (*SMALL, "coupled_arm", "rx90", "tx40", "floating_tree", "loops/four_bar")
CLAIMS = ("name", "rank", "outputs", "parameters", "order", "base", "classification", "generic", "model")
EVERY_LINK = ReadingOptions(keep_fixed_links=True)
VALID, REFUTED, UNREADABLE, NOT_COVERED = range(4)
# The independent verifier passes over what is said beside the rows, and over evidence of others: the program refuses
# these, and sets that are true but hold the certificate of another model.
ONLY_THE_PROGRAM = {
    *("certificate", "class", "count", "expression", "expression_hidden", "missing", "order", "pivot"),
    *("shape", "special", "swap_columns", "unit", "value", "value_nearly", "zero"),
}


@cache
def saved(name: str) -> str:
    return to_json(ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml")))


def is_its_own(text: str) -> bool:
    """Whether what a document claims is what is derived from its model."""
    data, model = json.loads(text), from_json(text)
    again = to_dict(ec.base_parameters(model.mechanism))
    for row in (*data["base"], *again["base"]):
        row["terms"].sort(key=itemgetter("parameter"))  # in any order they are the same sum
    return all(again[key] == data[key] for key in CLAIMS if key != "model")


def is_accepted(text: str) -> bool:
    try:
        ec.verify(from_json(text))
    except (ec.InputError, ec.CertificateError):
        return False
    return True


def check(forgery: Forged) -> None:
    accepted = is_accepted(forgery.text)
    code, sentence = judge(forgery.text)
    assert (code == REFUTED) == sentence.startswith("NOT valid"), sentence
    if accepted:
        assert is_its_own(forgery.text), forgery
        assert code in (VALID, NOT_COVERED), sentence
    elif code == VALID:
        data, true = json.loads(forgery.text), json.loads(saved(forgery.name))
        assert forgery.kind in ONLY_THE_PROGRAM or data["model"] != true["model"], forgery
        again = derived(data["model"]) or true
        both = np.vstack([rows(data), rows(again)])
        assert len(rows(data)) == len(rows(again)) == np.linalg.matrix_rank(both), forgery


def derived(model: Any) -> dict[str, Any]:
    """The set of a model, or nothing where the program does not read all that is said about it."""
    try:
        return to_dict(ec.base_parameters(read_description(json.dumps(model).encode(), "forged", EVERY_LINK)))
    except ec.InputError:
        return {}


def rows(data: dict[str, Any]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """The coefficients at some values of the symbols; sets that span the same are equally true."""
    found = np.zeros((len(data["base"]), len(data["parameters"])))
    for i, term in ((i, term) for i, row in enumerate(data["base"]) for term in row["terms"]):
        coefficient = RationalFunction(parse(term["coefficient"]), parse(term.get("denominator", "1")))
        values = {name: 0.3 + len(name) / 7 + sum(map(ord, name)) / 999 for name in coefficient.symbols()}
        generators = {*coefficient.numerator.generators(), *coefficient.denominator.generators()}
        column = data["parameters"].index(term["parameter"])
        found[i, column] += coefficient.evaluate(float_generators(generators, values), float)
    return found


@pytest.mark.parametrize("part", one_in(3, range(3)))
def test_forgeries_are_refused(part: int) -> None:
    for forgery in forged({name: saved(name) for name in SMALL}, len(FORGERIES), seed=part):
        check(forgery)


@pytest.mark.slow
def test_a_thousand_forgeries_are_refused() -> None:
    for forgery in forged({name: saved(name) for name in ALL}, 1000, seed=7):
        check(forgery)
