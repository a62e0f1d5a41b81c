"""Forged sets are refused, by the verification and by the verifier of its own, and never with a traceback."""

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
SMALL = ("double_pendulum", "scara", "gripper_coupled", "floating_tree", "loops/parallelogram")
ALL = (*SMALL, "coupled_arm", "rx90", "tx40", "furuta", "loops/four_bar")
CLAIMS = ("name", "rank", "outputs", "parameters", "order", "base", "classification", "generic", "model")
VALID, REFUTED, UNREADABLE, NOT_COVERED = range(4)


@cache
def saved(name: str) -> str:
    return to_json(ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml")))


def is_its_own(text: str) -> bool:
    """Whether what a document claims is what is derived from its model."""
    data, model = json.loads(text), from_json(text)
    again = to_dict(ec.base_parameters(model.mechanism))
    return all(again[key] == data[key] for key in CLAIMS)


def is_accepted(text: str) -> bool:
    try:
        ec.verify(from_json(text))
    except (ec.InputError, ec.CertificateError) as error:
        assert str(error)
        return False
    return True


def check(forgery: Forged) -> None:
    accepted = is_accepted(forgery.text)
    code, sentence = judge(forgery.text)
    assert code in range(4)
    assert sentence
    if forgery.kind == "certificate":  # evidence is of no interest to the verifier, which finds its own
        assert not accepted
    elif accepted or code == VALID:
        assert not accepted or is_its_own(forgery.text), forgery
        assert code != VALID or accepted or forgery.kind == "shape", forgery
    assert code != REFUTED or not accepted, sentence
