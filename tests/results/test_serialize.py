"""Saved sets: exact round trips, equal text for equal input, and refusal of whatever was altered."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields, replace
from fractions import Fraction
from math import prod
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import echelon as ec
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.certificate import Certificate, certify
from echelon.base.derive import model_at_stated_values
from echelon.base.saved.saved import from_json, to_json
from echelon.base.saved.schema import BaseModelRecord
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.robot.mechanism import Mechanism
from echelon.shared.record_schemas import file_schema
from support import textbook_arms as arms
from support.paths import ROOT
from support.selection import one_in, slow_unless

FOLDER = ROOT / "examples"
EXAMPLES = [
    *sorted(FOLDER.glob("*.*ml")),
    *(FOLDER / "loops" / f"{n}.yaml" for n in ("parallelogram", "sr400", "bennett")),
]


@pytest.fixture(scope="module")
def base() -> ec.BaseModel:
    return ec.base_parameters(arms.rx90())


@pytest.fixture
def saved(base: ec.BaseModel, tmp_path: Path) -> Path:
    file = tmp_path / "base.json"
    ec.save_base(base, file)
    return file


# -- round trips ------------------------------------------------------------------------------------------------------


def check_round_trip(model: ec.BaseModel) -> None:
    text = to_json(model)
    again = from_json(text)
    assert again == model  # the reading is not part of a mechanism's identity
    assert again.matrix.rows == model.matrix.rows
    assert again.reading == model.reading
    assert to_json(again) == text
    jsonschema.Draft202012Validator(file_schema(BaseModelRecord)).validate(
        json.loads(text)
    )
    assert ec.verify(again).rank == model.rank


QUICK = ("cart_pole", "furuta", "floating_tree", "tx40", "parallelogram")


@pytest.mark.parametrize(
    "file",
    slow_unless(lambda file: file.stem in QUICK, EXAMPLES),
    ids=lambda file: file.stem,
)
def test_examples(file: Path) -> None:
    check_round_trip(ec.base_parameters(ec.load(file)))


@pytest.mark.parametrize(
    "robot",
    [
        *arms.KINDS,
        lambda: arms.general_arm(7),
    ],  # the last one has coefficients of thousands of characters
)
@pytest.mark.parametrize("order", one_in(2, ["tip-to-base", "base-to-tip"]))
def test_every_kind_of_robot(robot: Callable[[], Mechanism], order: str) -> None:
    mechanism = robot()
    if mechanism.degrees_of_freedom < 7 or order == "base-to-tip":
        check_round_trip(ec.base_parameters(mechanism, order=order))


def test_equal_input_gives_equal_text() -> None:
    assert to_json(ec.base_parameters(arms.panda())) == to_json(
        ec.base_parameters(arms.panda())
    )


@pytest.mark.parametrize(
    "name",
    ["<b>\"'&|\\", "two\nlines", "ζ̄ 腕", "\x1b[31m\x00", "true", "1e5", "a" * 3000],
)
def test_any_name(name: str) -> None:
    check_round_trip(ec.base_parameters(replace(arms.double_pendulum(), name=name)))


@pytest.mark.parametrize(
    "name", ["<b>\"'&|\\", "ζ 腕", "left/arm", "true", "1e5", "a" * 3000]
)
def test_any_name_of_a_body(name: str) -> None:
    arm = arms.double_pendulum()
    bodies = tuple(replace(b, name=f"{name}{i}") for i, b in enumerate(arm.bodies))
    check_round_trip(ec.base_parameters(replace(arm, bodies=bodies)))


def test_numbers_beside_exact_coefficients(saved: Path) -> None:
    data = json.loads(saved.read_text(encoding="utf-8"))
    terms = {t["parameter"]: t for t in data["base"][0]["terms"]}
    assert terms["M6"] == {
        "parameter": "M6",
        "coefficient": "D3^2",
        "value": pytest.approx(0.45**2),
    }
    unknown = json.loads(to_json(ec.base_parameters(arms.stanford())))["base"][0][
        "terms"
    ]
    assert [t["value"] for t in unknown if "d2" in t["coefficient"]] == [None, None]


# -- verification -----------------------------------------------------------------------------------------------------


def test_a_saved_set_verifies_with_fresh_points(
    saved: Path, base: ec.BaseModel
) -> None:
    checks = [ec.verify(saved), ec.verify(saved), ec.verify(saved, seed=123)]
    assert [check.rank for check in checks] == [36] * 3
    primes = [
        p
        for certificate in (*checks, base.certificate)
        for p in certificate.identity_primes
    ]
    assert len(set(primes)) == 8
    assert ec.verify(saved, seed=checks[0].seed) == checks[0]


def test_a_loaded_set_computes_the_same(base: ec.BaseModel, saved: Path) -> None:
    again = ec.load_base(saved)
    np.testing.assert_array_equal(again.B_float(), base.B_float())
    assert str(again) == str(base)


def scaled(rows: list[dict[int, RationalFunction]]) -> None:
    rows[0][29] = rows[0][29] * RationalFunction(2)


FORGERIES: dict[str, Callable[[list[dict[int, RationalFunction]]], object]] = {
    "coefficient": scaled,
    "term dropped": lambda rows: rows[8].popitem(),
    "term added": lambda rows: rows[3].update({9: RationalFunction(1)}),
    "row dropped": lambda rows: rows.pop(4),
    "row added": lambda rows: rows.insert(0, {0: RationalFunction(1)}),
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_forgeries_that_agree_with_themselves_are_refuted(
    base: ec.BaseModel, tmp_path: Path, forgery: str
) -> None:
    rows = [dict(row) for row in base.matrix.rows]
    FORGERIES[forgery](rows)
    matrix = replace(
        base.matrix, rows=tuple(rows), pivots=tuple(min(row) for row in rows)
    )
    ec.save_base(
        replace(
            base, matrix=matrix, certificate=replace(base.certificate, rank=len(rows))
        ),
        tmp_path / "f",
    )
    assert ec.load_base(tmp_path / "f").matrix == matrix
    with pytest.raises(ec.CertificateError):
        ec.verify(tmp_path / "f")


def coefficient(data: Any) -> None:
    term = next(
        t for row in data["base"] for t in row["terms"] if "D3" in t["coefficient"]
    )
    term["coefficient"] = term["coefficient"].replace("D3", "RL4")


TAMPERED: dict[str, Callable[[Any], object]] = {
    "coefficient": coefficient,
    "sign": lambda data: data["base"][1]["terms"][1].update(coefficient="1"),
    "tiny change": lambda data: data["base"][1]["terms"][1].update(
        coefficient="-1.000000000000001"
    ),
    "row dropped": lambda data: data["base"].pop(3),
    "row dropped, rank adjusted": lambda data: (
        data["base"].pop(3),
        data["certificate"].update(rank=35),
    ),
    "term dropped": lambda data: data["base"][0]["terms"].pop(),
    "term of zero": lambda data: data["base"][0]["terms"].append(
        {"parameter": "XX1", "coefficient": "0"}
    ),
    "term moved": lambda data: data["base"][0]["terms"][-1].update(parameter="M2"),
    "row added": lambda data: data["base"].insert(
        0,
        {
            "name": "XX1",
            "unit": "",
            "expression": "",
            "terms": [{"parameter": "XX1", "coefficient": "1"}],
        },
    ),
    "rows swapped": lambda data: data["base"].reverse(),
    "order": lambda data: data["order"].reverse(),
    "another gravity": lambda data: data["model"].update(gravity=[1, 2, 3]),
    "another joint": lambda data: data["model"]["bodies"][2]["joint"]["steps"][
        -1
    ].update(motion="translation"),
    "another length": lambda data: data["model"]["symbols"].update(D3="0.5"),
    "certificate of another rank": lambda data: data["certificate"].update(rank=35),
    "rank": lambda data: data.update(rank=35),
    "name": lambda data: data.update(name="another robot"),
    "outputs": lambda data: data["outputs"].pop(),
    "classification": lambda data: data["classification"]["unidentifiable"].pop(),
    "expression": lambda data: data["base"][0].update(expression="ZZ1 + YY2"),
    "unit": lambda data: data["base"][0].update(unit="kg"),
    "value": lambda data: data["base"][0]["terms"][-1].update(value=0.2),
    "value withheld": lambda data: data["base"][0]["terms"][-1].update(value=None),
}


@pytest.mark.parametrize("case", TAMPERED)
def test_tampered_files_are_refuted(saved: Path, case: str) -> None:
    data = json.loads(saved.read_text(encoding="utf-8"))
    TAMPERED[case](data)
    saved.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ec.CertificateError):
        ec.verify(saved)


def test_the_wording_counts_whatever_version_wrote_it(saved: Path) -> None:
    data = json.loads(saved.read_text(encoding="utf-8"))
    data["echelon"] = "0.0.9"
    data["base"][0]["expression"] += " + 7·M6"
    saved.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ec.CertificateError, match="expression"):
        ec.verify(saved)


def test_knowing_the_recorded_primes_does_not_help(
    base: ec.BaseModel, tmp_path: Path
) -> None:
    certificate = base.certificate
    known = prod(certificate.identity_primes) * certificate.minor_prime
    rows = [dict(row) for row in base.matrix.rows]
    rows[0][29] = rows[0][29] + RationalFunction(Fraction(known, 10**90))
    forged = replace(base, matrix=replace(base.matrix, rows=tuple(rows)))
    forms = virtual_power_form(forged.mechanism)
    # the repetition with the recorded seed cannot notice it: all its primes are known
    repeated = certify(
        forms, forged.matrix, certificate.seed, model_at_stated_values(forged.mechanism)
    )
    assert repeated.identity_primes == certificate.identity_primes
    ec.save_base(replace(forged, certificate=repeated), tmp_path / "f")
    with pytest.raises(ec.CertificateError, match="effect of M3"):
        ec.verify(tmp_path / "f")


EVIDENCE: dict[str, Any] = {
    "seed": 7,
    "minor_prime": 2147483647,
    "minor_states": 1,
    "identity_primes": ["1208925819614629174706189"] * 2,
    "degree": 1,
    "log10_error": -60.0,
    "at_values": False,
    "regions": 3,
    "regions_note": "which is enough for all products of signs that occur",
    "other_values": 9,
    "rounding": 0.01,
    "numbers": 1,
    "log10_residual": -40.0,
    "ball_states": 20,
    "closed": True,
    "columns": {"minor": 60},
    "unchecked": ["everything"],
}


def test_every_part_of_the_evidence_can_be_forged_here() -> None:
    assert {*EVIDENCE, "rank"} == {field.name for field in fields(Certificate)}


@pytest.mark.parametrize("name", EVIDENCE)
def test_evidence_that_its_seed_does_not_give_is_refused(
    saved: Path, name: str
) -> None:
    data = json.loads(saved.read_text(encoding="utf-8"))
    data["certificate"][name] = EVIDENCE[name]
    saved.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ec.CertificateError, match=r"recorded|seed"):
        ec.verify(saved)


DAMAGED: dict[str, Callable[[str], str]] = {
    "truncated": lambda text: text[: len(text) // 2],
    "not json": lambda _: "hello",
    "empty": lambda _: "",
    "list": lambda _: "[]",
    "schema": lambda text: text.replace("base-model/1", "base-model/9"),
    "expression": lambda text: text.replace('"D3^2"', '"__import__(1)"'),
    "division by zero": lambda text: text.replace(
        '"D3^2"', '"1", "denominator": "D3-D3"'
    ),
    "term twice": lambda text: text.replace('"parameter": "M6"', '"parameter": "M5"'),
    "unknown parameter": lambda text: text.replace(
        '"parameter": "M6"', '"parameter": "M9"'
    ),
    "extra key": lambda text: text.replace('"seed"', '"sede"', 1),
    "negative seed": lambda text: text.replace('"seed": 2015', '"seed": -1'),
    "prime": lambda text: text.replace(
        '"identity_primes": [', '"identity_primes": ["p", '
    ),
    "nan": lambda text: text.replace('"rank": 36', '"rank": NaN'),
    "no model": lambda text: text[: text.index('"model"')] + '"model": {}}',
}


@pytest.mark.parametrize("case", DAMAGED)
def test_damaged_files_are_input_errors(saved: Path, case: str) -> None:
    text = DAMAGED[case](saved.read_text(encoding="utf-8"))
    assert text != saved.read_text(encoding="utf-8")
    saved.write_text(text, encoding="utf-8")
    with pytest.raises(ec.InputError, match=r"base\.json"):
        ec.verify(saved)


def test_files_that_are_none() -> None:
    for path in ("nowhere.json", "."):
        with pytest.raises(ec.InputError, match="cannot be read"):
            ec.load_base(path)
    with pytest.raises(ec.InputError, match="cannot be written"):
        ec.save_base(ec.base_parameters(arms.rigid()), "nowhere/base.json")
