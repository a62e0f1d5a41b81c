"""The Stäubli TX40 with its coupled wrist, and the published set of base parameters."""

from __future__ import annotations

import csv

import pytest

import echelon as ec
from support.measured_logs import measured
from support.paths import ROOT


@pytest.fixture(scope="module")
def tx40() -> ec.BaseModel:
    return ec.base_parameters(ec.load(ROOT / "examples" / "tx40.yaml"))


@pytest.fixture
def published() -> list[str]:
    """The published base parameters as expressions."""
    file = measured("staubli_tx40/reference/TX40_bp_5.csv")
    return [row[0] for row in csv.reader(file.read_text().splitlines())]


def test_rank_with_drives_and_coupled_wrist(tx40: ec.BaseModel) -> None:
    """36 of the bodies; 4 rotor inertias that count to no link; viscous, Coulomb, offset of 6 axes; 3 of the wrist."""
    assert tx40.rank == 36 + 4 + 18 + 3
    alone = {
        name
        for name, seen in tx40.classification.items()
        if seen is ec.Identifiability.ALONE
    }
    assert {"Ia3", "Ia6", "Fv6", "Fc1", "Fo5", "Iam6", "fvm6", "fsm6"} <= alone
    first = tx40.expressions[0]
    assert first.name == "ZZ1"
    assert "Ia1" in str(first)


def test_the_published_set_is_right_and_misses_one_rotor(
    tx40: ec.BaseModel, published: list[str]
) -> None:
    found = ec.audit(tx40, published)
    assert len(found.findings) == 60
    assert found.verdict.name == "INCOMPLETE"
    assert len(found.missing) == 1
    assert "missing: Ia6" in found.to_text()
    assert ec.audit(tx40, [*published, "Ia6"]).equal


def test_a_wrong_coefficient_is_named(tx40: ec.BaseModel, published: list[str]) -> None:
    claims = list(published)
    claims[9] = claims[9].replace("0.225*m4", "0.325*m4")
    found = ec.audit(tx40, [*claims, "Ia6"])
    assert found.verdict.name == "WRONG"
    assert [f.agreement.name for f in found.findings].count("WRONG") == 1
