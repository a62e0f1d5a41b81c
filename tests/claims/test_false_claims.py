"""Claims that hold in most places only: the certificate looks at all columns, all rows and many regions."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction

import pytest

import echelon as ec
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.certificate import certify
from echelon.base.matrix import BaseMatrix
from echelon.dynamics.linear_forms import (
    inverse_dynamics_regressor,
    virtual_power_form,
)
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from support import textbook_arms as arms
from support.descriptions import read_description
from support.paths import ROOT

LOOPS = ROOT / "examples" / "loops"
CORNER = "qd*(1 + sign(qd))*(1 + sign(qd[j2]))*(1 + sign(qd[j3]))"
"""Friction that acts in one of eight regions."""


def refused(mechanism: Mechanism, matrix: BaseMatrix, seed: int = 7) -> str:
    for forms in (virtual_power_form, inverse_dynamics_regressor):
        with pytest.raises(ec.CertificateError) as caught:
            certify(forms(mechanism), matrix, seed)
    return str(caught.value)


@pytest.mark.parametrize("row", [0, 7])
@pytest.mark.parametrize("factor", [7, Fraction(1, 10**12)])
def test_an_invisible_parameter_in_a_base_parameter_is_found(
    row: int, factor: int | Fraction
) -> None:
    """The columns of XX1 to MZ1 and of M1 are structurally zero: nothing of X is there to compare with."""
    base = ec.base_parameters(arms.rx90())
    for name in ("M1", "YY1"):
        column = base.parameters.index(name)
        if column < base.matrix.pivots[row]:
            continue
        rows = [dict(r) for r in base.matrix.rows]
        rows[row][column] = RationalFunction(factor)
        assert name in refused(base.mechanism, replace(base.matrix, rows=tuple(rows)))


def test_an_invisible_parameter_in_a_base_parameter_of_a_linkage_is_found() -> None:
    base = ec.base_parameters(ec.load(LOOPS / "parallelogram.yaml"))
    rows = [dict(r) for r in base.matrix.rows]
    rows[0][base.parameters.index("M1")] = RationalFunction(7)
    with pytest.raises(ec.CertificateError, match="M1"):
        certify(
            virtual_power_form(base.mechanism),
            replace(base.matrix, rows=tuple(rows)),
            seed=7,
        )


@pytest.fixture(scope="module")
def cornered() -> ec.BaseModel:
    rows = [{"joint": "revolute", "alpha": "pi/2", "a": "0.2"}] * 3
    effects = [
        {"type": "viscous", "at": "j1", "side": "joint"},
        {
            "parameter": "corner",
            "unit": "N·m·s/rad",
            "acts": [{"at": "j1", "side": "joint", "term": CORNER}],
        },
    ]
    data = {"echelon": 1, "name": "arm", "modified_dh": rows, "effects": effects}
    return ec.base_parameters(
        read_description(json.dumps(data), "arm", ReadingOptions())
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_claim_that_holds_in_seven_of_eight_regions_is_refused(
    cornered: ec.BaseModel, seed: int
) -> None:
    """A friction of one region only is left out, or claimed to equal another one."""
    matrix = cornered.matrix
    column = matrix.parameters.index("corner")
    k = matrix.pivots.index(column)
    rest = tuple(row for i, row in enumerate(matrix.rows) if i != k)
    cut = replace(
        matrix, pivots=tuple(p for p in matrix.pivots if p != column), rows=rest
    )
    assert "corner" in refused(cornered.mechanism, cut, seed)
