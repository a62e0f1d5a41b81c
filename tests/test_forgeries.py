"""Forged sets are refused, by the verification and by the independent verifier, and never with a traceback."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

import echelon as ec
from echelon.results.echelon_verify import judge
from echelon.results.saved import from_json, to_dict, to_json
from forgeries import FORGERIES, Forged, forged

EXAMPLES = Path(__file__).parents[1] / "examples"
SMALL = ("double_pendulum", "scara", "gripper_coupled", "furuta", "loops/parallelogram")
ALL = (*SMALL, "coupled_arm", "rx90", "tx40", "floating_tree", "loops/four_bar")
CLAIMS = ("name", "rank", "outputs", "parameters", "order", "base", "classification", "generic", "model")
VALID, REFUTED, UNREADABLE, NOT_COVERED = range(4)
# until a verification draws from the system's entropy and compares what is recorded, it takes these for true
TRUSTED = ("certificate", "prime_aware")


@cache
def saved(name: str) -> str:
    return to_json(ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml")))


def is_its_own(text: str) -> bool:
    """Whether what a document claims is what is derived from its model."""
    data, model = json.loads(text), from_json(text)
    again = to_dict(ec.base_parameters(model.mechanism))
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
    if accepted and forgery.kind not in TRUSTED:
        assert is_its_own(forgery.text), forgery
        assert code in (VALID, NOT_COVERED), sentence
    elif code == VALID:  # it finds evidence of its own, and passes over records and remarks
        data, true = json.loads(forgery.text), json.loads(saved(forgery.name))
        assert forgery.kind in ("certificate", "shape"), forgery
        assert all(data[key] == true[key] for key in CLAIMS if key != "model"), forgery


@pytest.mark.parametrize("part", range(5))
def test_forgeries_are_refused(part: int) -> None:
    for forgery in forged({name: saved(name) for name in SMALL}, len(FORGERIES), seed=part):
        check(forgery)


@pytest.mark.slow
def test_a_thousand_forgeries_are_refused() -> None:
    for forgery in forged({name: saved(name) for name in ALL}, 1000, seed=7):
        check(forgery)
