"""Regions of signs: small, distant and hidden ones are found, what was found is said, and the rank is that of all."""

from __future__ import annotations

import math

import numpy as np
import pytest

import echelon as ec
from echelon.algebra.program.free_states import RealPoints, RegionReport
from echelon.algebra.program.surfaces import (
    IndependentRegions,
    find_surfaces,
    impossible,
)
from echelon.algebra.program.tape import Program
from echelon.algebra.program.text import record_expression
from echelon.base.linear_base import LinearBase
from support.selection import slow_unless
from support.sign_models import sign_model


def base_of(
    columns: list[str], variables: str, constants: dict[str, object] | None = None
) -> LinearBase:
    names = [f"p{i}" for i in range(len(columns))]
    return ec.base_parameters(
        ec.LinearModel([columns], variables.split(), names, constants)
    )


def box(count: int) -> str:
    """Zero but where x_i > 10^i for all i."""
    return "*".join(f"(1 + sign(x{i} - 1e{i}))" for i in range(count))


# columns, variables, rank, regions
NAMED: dict[str, tuple[list[str], str, int, int]] = {
    "distant": (["1", "sign(x - 1000)"], "x", 2, 2),
    "dead zone": (["1", "sign(v - 0.001)", "sign(v + 0.001)"], "v", 3, 3),
    "dead zone as a product": (["1", "sign(v - 0.001)*sign(v + 0.001)", "sign(v + 0.001)"], "v", 3, 3),
    "dead zone as a maximum": (["v", "max(0, v - 0.001) + min(0, v + 0.001)", "1"], "v", 3, 3),
    "end stop": (["q", "(q - 200)*(1 + sign(q - 200))/2"], "q", 2, 2),
    "end stop as a maximum": (["1", "q", "max(0, q - 200)"], "q", 3, 2),
    "eight signs": (["1", box(8)], " ".join(f"x{i}" for i in range(8)), 2, 256),
    "peak": (["1", "sign(cos(x) - 0.9999)"], "x", 2, 2),
    "peak of a product": (["1", "sign(sin(x)*cos(y) - 0.99999)"], "x y", 2, 2),
    "three peaks": (["1", "(1 + sign(cos(x) - 0.9999))*(1 + sign(cos(y) - 0.999))*(1 + sign(sin(z) - 0.99))"],
                    "x y z", 2, 8),
    "differences": (["1", "sign(x - y - 5)", "sign(y - z - 0.01)", "sign(x - y - 5)*sign(y - z - 0.01)"],
                    "x y z", 4, 4),
    "order": (["1", "sign(x - y)", "sign(y - z)", "sign(x - z)", "sign(x - y)*sign(y - z)*sign(x - z)"], "x y z", 4, 6),
    "thin slab": (["1", "(1 + sign(x + y + z - 300))*(1 + sign(300.001 - x - y - z))"], "x y z", 2, 3),
    "small ball": (["1", "sign(1e-6 - (x - 1000)**2 - (y + 500)**2 - (z - 3)**2)"], "x y z", 2, 2),
    "no such corner": (["1", "(1 + sign(x))*(1 + sign(y))*(1 - sign(x + y))"], "x y", 1, 6),
    "seven steps": (["1", "*".join(f"(1 + sign(x - {k}))" for k in range(7))], "x", 2, 8),
    "overflow": (["1", "sign(exp(x) - 1e300)"], "x", 2, 2),
    "domain of a maximum": (["x/max(x, 0)", "x", "1"], "x", 2, 1),
    "zero on a half": (["1", "sign(max(x, 0))", "sign(max(x, 0))**2"], "x", 2, 2),
    "zero everywhere": (["1", "sign(sin(x)**2 + cos(x)**2 - 1)"], "x", 1, 1),
    "zero in every digit": (["x", "sign((x + y) - x - y + 0*x)", "sign((x*y)/y - x) + x"], "x y", 1, 1),
    "distant domain": (["1", "log(x - 1e5)", "sign(x - 2e5)"], "x", 3, 2),
    "sign of a sign": (["1", "sign(x - 10*sign(y - 100))"], "x y", 2, 2),
    "sum of thirty": (["1", " + ".join(f"sign(x{i} - {i})" for i in range(30))],
                      " ".join(f"x{i}" for i in range(30)), 2, 31),
}  # fmt: skip


@pytest.mark.parametrize("name", slow_unless(lambda name: name != "eight signs", NAMED))
def test_regions_are_found(name: str) -> None:
    columns, variables, rank, regions = NAMED[name]
    base = base_of(columns, variables)
    assert (base.rank, base.certificate.regions) == (rank, regions)
    assert f"in {regions} region" in str(base.certificate)


def test_stated_constants_decide() -> None:
    columns = ["1", "(1 + sign(v - a))*(1 - sign(v - b))"]
    assert base_of(columns, "v", {"a": 1, "b": 1.001}).rank == 2
    assert base_of(columns, "v", {"a": 1.001, "b": 1}).rank == 1
    unstated = base_of(columns, "v", {"a": None, "b": 2})
    assert "regions as for a = " in str(unstated.certificate)
    assert "which have no stated value" in str(unstated.certificate)


def test_what_was_found_is_said() -> None:
    assert "sign(cos(x) - 2): negative everywhere" in str(
        base_of(["1", "sign(cos(x) - 2)"], "x").certificate
    )
    hidden = base_of(["1", "sign(x**2 + y**2 - 2*x*y + 1/1000)"], "x y").certificate
    assert "only positive values were found" in str(hidden)
    assert "assumed: that no other region adds anything" in str(hidden)
    zero = base_of(["1", "sign(sin(x)**2 + cos(x)**2 - 1)"], "x").certificate
    assert "zero as far as 512 bits tell" in str(zero)
    enough = base_of(["1", "sign(x)", "sign(y)"], "x y").certificate
    assert (
        "in 3 regions of signs, which is enough for all products of signs that occur"
        in str(enough)
    )
    assert "region" not in str(base_of(["1", "x"], "x").certificate)


def test_certificates_state_their_regions() -> None:
    report = RegionReport(7, "budget", ("sign(x): only positive values were found",))
    assert str(report) == (
        "in 7 regions of signs; assumed: that no other region adds anything (the search ended by its budget); "
        "sign(x): only positive values were found"
    )


def test_a_false_relation_in_one_small_region_is_caught() -> None:
    """A set that is right in all regions but one of 32 does not pass."""
    from dataclasses import replace

    from echelon.base.certificate import certify

    base = base_of(["1", box(5)], "x0 x1 x2 x3 x4")
    wrong = replace(
        base.matrix, pivots=base.matrix.pivots[:1], rows=base.matrix.rows[:1]
    )
    with pytest.raises(
        ec.CertificateError, match="does not reproduce the effect of p1"
    ):
        certify(base.model.regressor, wrong, seed=1)


def recorded(texts: list[str]) -> tuple[Program, list[int]]:
    program = Program()
    names = {name: program.input(name) for name in "xyzv"} | {
        "a": program.input("a", "symbol")
    }
    return program, [
        record_expression(text, names, "test", program).node for text in texts
    ]


def test_products_that_occur() -> None:
    program, outputs = recorded(
        ["sign(x) + sign(y)", "sign(y)*sign(z)*v", "exp(sign(x)*v)", "x*y*z"]
    )
    shown = {
        frozenset(program.inputs[n].name for n in s)
        for s in find_surfaces(program, outputs).maximal
    }
    assert shown == {frozenset("x"), frozenset("yz")}
    program, outputs = recorded(
        ["(sign(x) + sign(y))*(1 + sign(z))", "1/(2 + sign(x)*sign(v))"]
    )
    shown = {
        frozenset(program.inputs[n].name for n in s)
        for s in find_surfaces(program, outputs).maximal
    }
    assert shown == {frozenset("xz"), frozenset("yz"), frozenset("xv")}


EXCLUDED = {
    "sign(v - 3)*sign(v + 3)": {"-+"},  # in the order of the surfaces
    "sign(v + 3)*sign(3 - 2*v)": {"--"},
    "sign(v - 3)*sign(6*x - 2*v)*sign(v - 1)": {"-+"},
    "sign(v - 3)*sign(6 - 2*v)": {"++", "--"},
    "sign(v - a)*sign(v + 2*a)": {"-+"},
    "sign(cos(x) - 1/2)*sign(cos(x) + y)*sign(2*cos(x) + 2*y + 3)": {"+-"},
    "sign(x)*sign(y)*sign(x + y)": set(),
    "sign(v - 3) + sign(v + 3)": set(),  # not multiplied
}


@pytest.mark.parametrize("text", EXCLUDED)
def test_excluded_combinations(text: str) -> None:
    """Against the signs at many points: excluded pairs do not occur."""
    program, outputs = recorded([text])
    surfaces = find_surfaces(program, outputs)
    constants = {program.input("a", "symbol").node: 0.7}
    found = impossible(surfaces, constants)
    shown = {"".join("+" if s > 0 else "-" for _, s in pair) for pair in found}
    assert {frozenset(pair) for pair in shown} == {
        frozenset(pair) for pair in EXCLUDED[text]
    }
    signs = RealPoints(program, outputs, {"a": "0.7"}).signs(200)
    points = {program.lhs[n]: sides for n, sides in signs.items()}
    for (f, s), (g, t) in found:
        assert not ((points[f] == s) & (points[g] == t)).any()


def test_parallel_surfaces_need_no_assumption() -> None:
    columns = [f"sign(v{i} - 0.1)*sign(v{i} + 0.1)" for i in range(6)]
    base = base_of([*columns, "1"], " ".join(f"v{i}" for i in range(6)))
    assert (base.rank, base.certificate.regions) == (7, 13)
    assert "enough for all products" in str(base.certificate)


def test_independent_regions() -> None:
    independent = IndependentRegions([(), ((0, 1),), ((1, 1),)])
    signs = np.array([[1, 1, -1, -1], [1, 1, 1, -1]], dtype=np.int8)
    assert independent.include(signs[:, :1], lambda _: True) == [0]
    assert independent.adds(signs).tolist() == [False, False, True, True]
    assert independent.include(signs, lambda k: k > 2) == [3]
    assert not independent.complete
    assert independent.include(signs, lambda _: True) == [2]
    assert independent.complete


def test_points_are_in_their_regions_and_differ() -> None:
    program, outputs = recorded(
        ["sign(v - a)*sign(v + a)*x", "sign(cos(y) - 0.9999)", "log(z - 50)"]
    )
    points = RealPoints(program, outputs, {"a": "0.001"})
    reals = points.draw(np.random.default_rng(3), 60)
    v, y, z = (reals[program.input(name).node] for name in "vyz")
    for k in range(points.count):
        own = slice(k, None, points.count)
        assert (
            len(set(np.sign(np.abs(v[own]) - 0.001)))
            == len(set(np.sign(np.cos(y[own]) - 0.9999)))
            == 1
        )
    assert (z > 50).all()
    assert len(set(v.tolist())) == 60
    again = RealPoints(program, outputs, {"a": "0.001"}).draw(
        np.random.default_rng(3), 60
    )
    assert all((again[n] == reals[n]).all() for n in reals)


@pytest.mark.parametrize("seed", slow_unless([0, 2], range(204)))
def test_random_models(seed: int) -> None:
    check(seed)


def check(seed: int) -> None:
    model = sign_model(seed)
    names = [f"p{i}" for i in range(len(model.columns))]
    base = ec.base_parameters(
        ec.LinearModel([list(model.columns)], model.variables, names)
    )
    assert base.rank == model.rank
    assert base.certificate.regions <= model.regions
    assert math.isfinite(base.certificate.log10_error)
