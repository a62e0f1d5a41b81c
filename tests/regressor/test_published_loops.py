"""Published mechanisms with loops: ranks are those that the oracle finds at closed states in 75 digits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import echelon as ec
from echelon.base.saved.saved import to_json
from echelon.cli.commands import app
from support.published_loops import ASSEMBLED, LOOPS, PUBLISHED, Published

# parallelograms to sixteen digits, of which the oracle takes twelve, or to eight units of the last of six digits
INTENDED = {"robotiq_2f85_v4": 3, "planar_delta": 20}
QUICK = (
    "planar_2dof",
    "five_bar",
    "palletizer_kr700_general",
    "talos_like",
    "xarm7_gripper",
)


def load(model: Published) -> ec.Mechanism:
    file = (
        model.file if model.file.suffix == ".xml" else model.file.with_suffix(".yaml")
    )
    return ec.load(file, floating=model.floating)


def check(model: Published) -> None:
    mechanism = load(model)
    assert mechanism.degrees_of_freedom == model.freedom
    assert ec.base_structure(mechanism).rank == INTENDED.get(model.name, model.rank)


@pytest.mark.parametrize(
    "model", [m for m in PUBLISHED if m.name in QUICK and not m.floating], ids=str
)
def test_ranks_are_those_of_the_oracle(model: Published) -> None:
    check(model)


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [m for m in PUBLISHED if m.name not in QUICK or m.floating], ids=str
)
def test_all_ranks_are_those_of_the_oracle(model: Published) -> None:
    check(model)


@pytest.mark.slow
def test_a_parallelogram_that_misses_by_eight_last_decimals_is_a_doubt() -> None:
    """Its bars of 19 mm differ by 0.8 μm; what these show is as large as what true values of mechanisms may show.

    To the letter, a quaternion with a component of 1.9e-5, which is read as zero, tells the fingers apart.
    """
    base = ec.base_parameters(
        load(next(m for m in PUBLISHED if m.name == "robotiq_2f85_v4")), budget=0
    )
    assert (base.rank, base.reading.literal_rank) == (3, 13)
    assert "3, 4, 5, 6, 7 or 8" in base.reading.doubt


@pytest.mark.slow
@pytest.mark.parametrize("model", ASSEMBLED, ids=str)
def test_sets_of_models_that_are_open_at_zero(model: Published) -> None:
    """The loops of one hold its knee and the drive of it, in whatever precision, so a doubt says that."""
    mechanism = load(model)
    assert mechanism.degrees_of_freedom == model.freedom
    base = ec.base_parameters(mechanism)
    assert base.rank == model.rank
    assert base.certificate.in_balls
    held = model.name == "kangaroo_like"
    assert base.reading.doubt.startswith(
        "the loops lock joints that have drives: 'motor_knee'" if held else ""
    )
    assert held or not base.reading.doubt


@pytest.mark.slow
@pytest.mark.parametrize("name", ["digit_like", "digit_like_links", "disney_like"])
def test_the_literal_reading_of_legs_is_compared(name: str) -> None:
    """It is closed in ball arithmetic, too, and rounding shows there."""
    model = next(m for m in PUBLISHED if m.name == name)
    base = ec.base_parameters(load(model), budget=0)
    assert (base.rank, base.reading.literal_rank) == (model.rank, model.rank)
    assert not base.reading.doubt


@pytest.mark.slow
def test_a_set_is_derived_from_the_frames_as_stated_and_verified(
    tmp_path: Path,
) -> None:
    """The loops are closed in ball arithmetic."""
    model = next(m for m in PUBLISHED if m.name == "planar_delta")
    mechanism = load(model)
    base = ec.base_parameters(mechanism, budget=0.02)
    assert base.rank == INTENDED[model.name]
    saved = tmp_path / "set.json"
    saved.write_text(to_json(base), encoding="utf-8")
    done = CliRunner().invoke(app, ["verify", str(saved)])
    assert "valid, 20 base parameters" in done.output


@pytest.mark.slow
def test_a_platform_on_legs_of_six_joints_has_a_set() -> None:
    """Closed poses modulo primes are rare there, so the set comes from balls."""
    model = next(m for m in PUBLISHED if m.name == "wl16_like_links")
    base = ec.base_parameters(load(model))
    assert base.rank == model.rank
    assert base.matrix.numbers is not None
    assert 0 < base.matrix.numbers.radius < 1e-30
    assert base.certificate.in_balls


@pytest.mark.slow
def test_relations_that_rounding_breaks_stay_broken_in_the_literal_reading() -> None:
    reading = ec.base_parameters(ec.load(LOOPS / "reachy_mini.xml"), budget=0).reading
    assert (reading.literal_rank, len(reading.decisive)) == (115, 0)


@pytest.mark.slow
def test_representatives_are_not_what_rounding_leaves_of_a_column() -> None:
    """Places are rounded to 1e-16; no coefficient is of the size of its inverse, nor shown if it is that small."""
    base = ec.base_parameters(
        load(next(m for m in PUBLISHED if m.name == "planar_delta"))
    )
    assert np.abs(base.B_float()).max() < 100
    assert base.hidden > 0
    assert not any("e-" in str(expression) for expression in base.expressions)
