"""Row spaces of two models: what theory says of torques, energy and power, and what tells models apart."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given

import echelon as ec
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support import textbook_arms as arms
from support.paths import EXAMPLES
from support.random_mechanisms import mechanisms
from support.selection import examples, slow_unless


def example(name: str) -> Mechanism:
    return ec.load(EXAMPLES / f"{name}.yaml")


@examples(8)
@given(mechanisms())
def test_torques_energy_and_power_agree(mechanism: Mechanism) -> None:
    base = ec.base_parameters(mechanism)
    for other in (base, ec.energy_regressor(mechanism), ec.power_regressor(mechanism)):
        found = ec.same_row_space(mechanism, other)
        assert found
        assert (found.first, found.second, found.union) == (base.rank,) * 3
        assert found.only_first == found.only_second == ""
        assert len(set(found.primes)) == 2


@pytest.mark.parametrize(
    "name",
    slow_unless(["loops/parallelogram"], ["loops/four_bar", "loops/parallelogram"]),
)
def test_with_loops(name: str) -> None:
    robot = example(name)
    assert ec.same_row_space(ec.energy_regressor(robot), ec.base_parameters(robot))
    assert ec.same_row_space(ec.power_regressor(robot), robot)


def test_base_wrench_and_joint_torques_differ_by_ten() -> None:
    tree = example("floating_tree")
    wrench, torques = (
        replace(tree, measured=tree.outputs[:6]),
        replace(tree, measured=tree.outputs[6:]),
    )
    found = ec.same_row_space(wrench, torques)
    assert not found
    assert (found.first, found.second, found.union) == (39, 29, 39)
    assert found.only_first == "XX0 + XX4"
    assert found.only_second == ""
    assert ec.same_row_space(wrench, tree)
    assert ec.same_row_space(torques, tree).only_second == "XX0 + XX4"


def test_each_sees_what_the_other_does_not() -> None:
    """The first and the second joint of an arm, alone: the first one does not feel gravity."""
    arm = example("rx90")
    one, two = (replace(arm, measured=(arm.outputs[k],)) for k in (0, 1))
    found = ec.same_row_space(one, two)
    assert found.union > max(found.first, found.second)
    assert found.only_first
    assert found.only_second
    assert repr(found).startswith("RowSpaces(different: dimensions")


def test_another_geometry_is_another_row_space() -> None:
    """A link of twice the length; the same symbol has the same value in both."""
    rows = "R 0 0 0", "R 0 {} 0"
    short, long = (
        arms.modified_dh("arm", rows[0], rows[1].format(a), gravity="0 -g 0")
        for a in ("a", "2*a")
    )
    found = ec.same_row_space(short, long)
    assert (found.first, found.second, found.union) == (
        6,
        6,
        7,
    )  # together they see M2 alone
    assert (found.only_first, found.only_second) == ("ZZ1 + a²·M2", "ZZ1 + 4·a²·M2")


def test_representatives_and_the_order_of_parameters_do_not_matter() -> None:
    arm = example("rx90")
    assert ec.same_row_space(
        ec.base_parameters(arm), ec.base_parameters(arm, order="tip-to-base")
    )
    model = ec.LinearModel([["x", "2*x", "y"]], ["x", "y"], ["p", "q", "r"])
    turned = ec.LinearModel([["y", "2*x", "x"]], ["x", "y"], ["r", "q", "p"])
    assert ec.same_row_space(model, turned)
    assert ec.same_row_space(ec.base_parameters(model), turned)


def test_friction_has_no_energy_and_signs_have_regions() -> None:
    model = ec.LinearModel([["sign(x)", "x", "abs(x)"]], ["x"], ["c", "v", "w"])
    smaller = ec.LinearModel([["sign(x)", "x", "x"]], ["x"], ["c", "v", "w"])
    found = ec.same_row_space(model, smaller)
    assert (found.first, found.second, found.union) == (3, 2, 3)
    assert found.only_first in ("v", "w")
    with pytest.raises(InputError, match="have no energy"):
        ec.energy_regressor(example("tx40"))
    assert ec.same_row_space(example("tx40"), ec.power_regressor(example("tx40")))


def test_forms_without_names() -> None:
    """Rows recorded one by one; witnesses in numbers where coefficients are numbers."""
    arm = arms.modified_dh("arm", "R 0 0 0", "R 0 1/2 0", gravity="0 -9.81 0")
    forms = inverse_dynamics_regressor(arm)
    assert ec.same_row_space(forms, arm)
    still = inverse_dynamics_regressor(replace(arm, gravity=None))
    found = ec.same_row_space(still, forms)
    assert (found.first, found.second, found.only_second) == (4, 6, "p7 + (1/2)·p20")


def test_refusals() -> None:
    with pytest.raises(InputError, match="has no parameter"):
        ec.same_row_space(example("rx90"), example("panda"))
    with pytest.raises(InputError, match="20 and 60 columns"):
        ec.same_row_space(
            inverse_dynamics_regressor(example("double_pendulum")), example("rx90")
        )
    with pytest.raises(InputError, match="robot: cannot be read"):
        ec.same_row_space("robot", example("panda"))
    with pytest.raises(InputError, match="argument 'a' of same_row_space"):
        ec.same_row_space(3, example("panda"))  # type: ignore[arg-type]
