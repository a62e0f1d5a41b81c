"""Generated source does what NumPy does, in every language that runs here, also where the geometry is an argument."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import flint
import numpy as np
import numpy.typing as npt
import pytest
from click.testing import CliRunner

import echelon as ec
from echelon.algebra.program.function import Argument, Function
from echelon.algebra.program.operations import FUNCTIONS
from echelon.algebra.program.tape import Program
from echelon.cli.commands import app
from echelon.codegen import TARGETS, views
from echelon.codegen.language import Precision
from echelon.codegen.source import Subject, generate, printed
from echelon.dynamics.functions import FUNCTIONS as ALL
from echelon.dynamics.functions import LOOP_FUNCTIONS
from echelon.loops.assembly import Assembly
from echelon.shared.errors import InputError
from support import generated_code as generated
from support.paths import ROOT
from support.selection import one_in, slow_unless

Floats = npt.NDArray[Any]
LARGE = (1e-300, 1e2, -3e3, 99_999.5, 1e5, -1e5 - 1, 1e7, -1e12, 1e22)


def every_operation() -> Function:
    """All operations, nested, with numbers of all kinds, zeros, signs, and angles that are expressions."""
    program = Program()
    q = [program.input(f"q[{k}]") for k in range(5)]
    a, b = program.input("a", "symbol"), program.input("b", "symbol")
    entries = {}
    for k, op in enumerate(FUNCTIONS):
        entries[k, 0] = program.function(op, q[k % 5] * q[k % 5] + 1).node
        entries[k, 1] = (
            (-program.function(op, abs(q[k % 5])) * a - 0.1).node
            if op.name != "LOG"
            else q[0].node
        )
        entries[k, 2] = (program.function(op, (q[1] * q[1] + 2).sin() + 2) / (-b)).node
    last = len(FUNCTIONS)
    # numbers as a file may state them: negative, long, large and small
    entries[last, 0] = (
        q[0] * -0.1
        + (1 - q[1]) * 1e-9
        - (q[2] - (q[3] - q[4])) * 123456789.125
        - (-q[0] - 3)
    ).node
    entries[last, 1] = (
        (q[0] - q[1]).sin() * (q[0] - q[1]).cos() + (2 * q[2]).sin() / (q[3] * q[3] + 1)
    ).node
    entries[last, 2] = (-q[0]).node
    entries[last, 3] = program.constant(-2).node
    rows, columns = tuple(f"row {k}" for k in range(last + 1)), ("x", "y", "z", "w")
    arguments = (
        Argument(
            "q", tuple(s.node for s in q), tuple("abcde"), ("rad",) * 5, "positions"
        ),
        Argument(
            "qd", (program.input("qd[0]").node,), ("a",), ("rad/s",), "never used"
        ),
        Argument(
            "symbols",
            (a.node, b.node),
            ("a", "b"),
            ("m", "m"),
            "geometry",
            uniform=True,
        ),
    )
    return Function(
        "everything", program, arguments, entries, (rows, columns), (), "all operations"
    )


def nothing() -> Function:
    """A result without entries."""
    program = Program()
    nodes = tuple(program.input(f"q[{k}]").node for k in range(5))
    q = Argument("q", nodes, tuple("abcde"), ("rad",) * 5, "positions")
    return Function("nothing", program, (q,), {}, (("x", "y"),), (), "zeros")


def states(
    functions: tuple[Function, ...], samples: int, *, large: bool
) -> dict[str, Floats]:
    rng = np.random.default_rng(0)
    values: dict[str, Floats] = {}
    for a in (a for f in functions for a in f.arguments):
        if a.name not in values:
            values[a.name] = rng.uniform(
                -3, 3, (len(a),) if a.uniform else (samples, len(a))
            )
    values["q"][-1] = 0
    angles = [
        k for k, unit in enumerate(functions[0].arguments[0].units) if unit == "rad"
    ]
    if large:
        for k, angle in enumerate(LARGE):
            values["q"][k, angles[k % len(angles)]] = angle
    return values


def closed_states_of(mechanism: ec.Mechanism, samples: int) -> dict[str, Floats]:
    """States in which the loops are closed."""
    q, qd, qdd = Assembly(mechanism).random_closed_states(
        np.random.default_rng(3), samples
    )
    free = [
        mechanism.velocities.index(name) for name in mechanism.independent_velocities
    ]
    return {"q": q, "qd": qd[:, free], "qdd": qdd[:, free]}


def check(
    target: str,
    functions: tuple[Function, ...],
    files: Mapping[str, str],
    robot: str,
    folder: Path,
    **options: Any,
) -> None:
    precision = options.get("precision", "double")
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
        assert max(map(len, text.splitlines())) <= 180
    call = generated.RUNNERS[target](
        generated.Build(folder, robot, functions, precision)
    )
    values = states(functions, 24, large=options.get("large", True)) | options.get(
        "given", {}
    )
    if precision == "single":
        values = {
            name: array.astype(np.float32).astype(float)
            for name, array in values.items()
        }
    for function in functions:
        wanted, found = generated.reference(function, values), call(function, values)
        assert found.shape == wanted.shape
        scale = np.maximum(1, np.abs(wanted).max(axis=0))
        error = np.abs(found - wanted) / scale
        assert error.max() < (1e-13 if precision == "double" else 2e-5), function.name


@pytest.mark.parametrize("target", generated.RUNNERS)
def test_every_operation(target: str, tmp_path: Path) -> None:
    functions = (every_operation(), nothing())
    files = printed(
        functions, TARGETS[target], Precision.DOUBLE, "robot_x", Subject("x", (), {})
    )
    check(target, functions, files, "robot_x", tmp_path, large=False)


def robot(name: str, **reading: Any) -> Callable[[], ec.BaseModel]:
    return cache(
        lambda: ec.base_parameters(ec.load(ROOT / f"examples/{name}.yaml", **reading))
    )


ROBOTS = {
    "double_pendulum": robot("double_pendulum"),
    "panda": robot("panda"),
    "floating_tree": robot("floating_tree"),
    "coupled_arm": robot("coupled_arm"),
    "tx40": robot("tx40"),
}
LOOPS = {name: robot(f"loops/{name}") for name in ("four_bar", "sr400", "delta")}
QUICK = ("double_pendulum", "four_bar")


def cases() -> Iterator[object]:
    """All targets with all robots; compilers take their time."""
    for target in generated.RUNNERS:
        for name in ROBOTS:
            slow = name not in QUICK and (target, name) != ("python", "coupled_arm")
            yield pytest.param(target, name, marks=[pytest.mark.slow] * slow)


@pytest.mark.parametrize(("target", "name"), list(cases()))
def test_robots(target: str, name: str, tmp_path: Path) -> None:
    # XLA needs a minute for long functions
    wanted = (
        list(ALL)
        if target != "jax" or name in QUICK
        else ["inverse_dynamics", "gravity"]
    )
    source = generate(ROBOTS[name](), target, wanted, name="my_robot")
    check(target, source.functions, source, "my_robot", tmp_path)


def loop_cases() -> Iterator[object]:
    """All targets with all loops."""
    for target in generated.RUNNERS:
        for name in LOOPS:
            slow = name not in QUICK or target in ("cuda", "matlab")
            yield pytest.param(target, name, marks=[pytest.mark.slow] * slow)


@pytest.mark.parametrize(("target", "name"), list(loop_cases()))
def test_robots_with_loops(target: str, name: str, tmp_path: Path) -> None:
    base = LOOPS[name]()
    wanted = (
        [*ALL, *LOOP_FUNCTIONS] if target != "jax" else ["gravity", "closed_positions"]
    )
    source = generate(base, target, wanted, name="my_robot")
    given = closed_states_of(base.mechanism, 24)
    check(
        target, source.functions, source, "my_robot", tmp_path, large=False, given=given
    )


def test_generated_code_closes_loops_and_moves_them(tmp_path: Path) -> None:
    """As a controller would call it: from the last positions, with new independent ones, a few steps each time."""
    base = LOOPS["four_bar"]()
    source = generate(
        base,
        "c",
        ["closed_positions", "mass_matrix"],
        name="bar",
        parameters=PARAMETERS,
    )
    for name, text in source.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    call = generated.c(generated.Build(tmp_path, "bar", source.functions, "double"))
    closed, mass = source.functions
    q = Assembly(base.mechanism).pose[None]
    for crank in np.linspace(q[0, 0], q[0, 0] + 2 * np.pi, 400)[1:]:
        q[0, 0] = crank
        for _ in range(3):
            q = call(closed, {"q": q})
        expected = base.mass_matrix(q, list(PARAMETERS.values()))
        np.testing.assert_allclose(call(mass, {"q": q}), expected, rtol=1e-9)
    pose = Assembly(base.mechanism).pose
    np.testing.assert_allclose(
        np.cos(q[0]), np.cos(pose), atol=1e-9
    )  # after a whole turn


PARAMETERS = dict(
    zip(
        ("ZZ1", "MX1", "MY1", "ZZ2", "MX2", "MY2", "ZZ3", "MY3"),
        np.linspace(0.5, 0.9, 8),
        strict=True,
    )
)


@pytest.mark.parametrize(
    "target",
    slow_unless(
        lambda target: target not in ("jax", "matlab", "cuda"), generated.RUNNERS
    ),
)
def test_single_precision(target: str, tmp_path: Path) -> None:
    source = generate(
        ROBOTS["double_pendulum"](), target, list(ALL), precision="single"
    )
    check(
        target,
        source.functions,
        source,
        "double_pendulum",
        tmp_path,
        precision="single",
        large=False,
    )


@pytest.mark.parametrize("target", [t for t in generated.RUNNERS if TARGETS[t].splits])
def test_long_functions_are_cut_into_parts(
    target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(views, "LONGEST_PART", 60)
    source = generate(ROBOTS["panda"](), target, ("inverse_dynamics", "gravity"))
    assert any("part_3" in text for text in source.values())
    check(target, source.functions, source, "panda", tmp_path)


def base(name: str) -> ec.BaseModel:
    return ec.base_parameters(ec.load(ROOT / f"examples/{name}.yaml"))


def symbol_cases() -> list[object]:
    quick = {("python", "rx90")}
    quick |= {(target, "double_pendulum") for target in generated.RUNNERS}
    quick -= {("cuda", "double_pendulum"), ("matlab", "double_pendulum")}
    pendulums = [(target, "double_pendulum") for target in generated.RUNNERS]
    return slow_unless(quick, [*pendulums, ("c", "panda"), ("python", "rx90")])


@pytest.mark.parametrize(("target", "name"), symbol_cases())
def test_two_geometries_of_one_build(target: str, name: str, tmp_path: Path) -> None:
    model = base(name)
    chosen = (
        ["regressor", "inverse_dynamics"] if target != "jax" else ["inverse_dynamics"]
    )
    source = generate(model, target, chosen, name="arm", keep_symbols=True)
    for file, text in source.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    call = generated.RUNNERS[target](
        generated.Build(tmp_path, "arm", source.functions, "double")
    )
    rng = np.random.default_rng(5)
    labels = next(
        a.labels for a in source.functions[0].arguments if a.name == "symbols"
    )
    assert set(labels) <= set(model.mechanism.symbols)
    q, qd, qdd = rng.uniform(-2, 2, (3, 7, len(model.mechanism.velocities)))
    zeta = rng.normal(size=model.rank)
    for lengths in rng.uniform(0.2, 0.9, (2, len(labels))):
        symbols = dict(zip(labels, map(float, lengths), strict=True))
        wanted = {
            "regressor": model.regressor(q, qd, qdd, symbols),
            "inverse_dynamics": model.predict(q, qd, qdd, zeta, symbols),
        }
        for function in source.functions:
            assert (
                next(a.labels for a in function.arguments if a.name == "symbols")
                == labels
            )
            values = {
                "q": q,
                "qd": qd,
                "qdd": qdd,
                "parameters": zeta,
                "symbols": lengths,
            }
            found = call(function, values)
            np.testing.assert_allclose(found, wanted[function.name], atol=1e-11)


def test_only_some() -> None:
    model = base("panda")
    source = generate(model, "c", ["regressor"], keep_symbols=["a7", "d3"])
    argument = next(a for a in source.functions[0].arguments if a.name == "symbols")
    assert set(argument.labels) == {"a7", "d3"}
    header = source["panda.h"]
    assert "a7 [SI], 0.088 in the robot's file" in header
    assert "a7 = " not in header.partition("Put in as constants:")[2]
    assert "d5 = 0.384" in header.partition("Put in as constants:")[2]


def test_refusals() -> None:
    model = base("double_pendulum")
    with pytest.raises(InputError, match="no symbol 'l9' to keep \\(valid: g, l1\\)"):
        generate(model, "c", ["gravity"], keep_symbols=["l9"])
    with pytest.raises(InputError, match="'l1' is kept as an argument"):
        generate(model, "c", ["gravity"], keep_symbols=True, symbols={"l1": 1.0})
    with pytest.raises(InputError, match="belong to one geometry"):
        generate(
            model,
            "c",
            ["gravity"],
            keep_symbols=True,
            parameters=dict.fromkeys(model.pivots, 1.0),
        )


def test_command(tmp_path: Path) -> None:
    robot = str(ROOT / "examples/double_pendulum.yaml")
    arguments = [
        "generate",
        robot,
        "-o",
        str(tmp_path),
        "--function",
        "regressor",
        "--json",
        "--keep-symbols",
        "all",
    ]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0
    assert (
        json.loads(done.stdout)["functions"]["regressor"]["arguments"]["symbols"] == 2
    )


def circle() -> Function:
    program = Program()
    q = [program.input(f"q[{k}]") for k in range(4)]
    entries = {(0, k): x.sin().node for k, x in enumerate(q)} | {
        (1, k): x.cos().node for k, x in enumerate(q)
    }
    argument = Argument("q", tuple(x.node for x in q), tuple("abcd"), ("rad",) * 4)
    return Function(
        "circle",
        program,
        (argument,),
        entries,
        (("sine", "cosine"), tuple("abcd")),
        (),
        "circle points",
    )


FAST = ("-O3", "-march=native", "-ffp-contract=fast")
BUILDS = [("c", ()), ("c", FAST), ("cpp", ()), ("cpp", FAST)]


def build(folder: Path, target: str, flags: tuple[str, ...]) -> generated.Call:
    files = printed(
        [circle()], TARGETS[target], Precision.DOUBLE, "turn", Subject("turn", (), {})
    )
    for name, text in files.items():
        (folder / name).write_text(text)
    return generated.RUNNERS[target](
        generated.Build(folder, "turn", (circle(),), "double", flags)
    )


def ulps(x: float, found: float, cosine: bool) -> float:
    exact = flint.arb(x).cos() if cosine else flint.arb(x).sin()
    return abs(float((flint.arb(found) - exact) / np.spacing(abs(float(exact)))))


@pytest.mark.parametrize(("target", "flags"), one_in(2, BUILDS))
def test_errors_in_units_in_the_last_place(
    target: str, flags: tuple[str, ...], tmp_path: Path
) -> None:
    rng = np.random.default_rng(3)
    multiples = rng.integers(-60_000, 60_000, 1500) * (np.pi / 2)
    pieces = [
        rng.uniform(-1e5, 1e5, 1500),
        rng.uniform(-7, 7, 1500),
        multiples,
        np.nextafter(multiples, 1e9),
        rng.integers(-120_000, 120_000, 500) * (np.pi / 4),
        10.0 ** rng.uniform(-300, 0, 500),
        np.array([1e5, -1e5, 0.0, 5e-324]),
    ]
    q = np.concatenate(pieces)
    q = q[np.abs(q) <= 1e5]
    q = q[: len(q) // 4 * 4].reshape(-1, 4)
    found = build(tmp_path, target, flags)(circle(), {"q": q})
    with flint.ctx.workprec(300):
        sines = [
            ulps(float(x), float(y), False)
            for x, y in zip(q.ravel(), found[:, 0].ravel(), strict=True)
        ]
        cosines = [
            ulps(float(x), float(y), True)
            for x, y in zip(q.ravel(), found[:, 1].ravel(), strict=True)
        ]
    assert max(sines) < 2
    assert max(cosines) < 2


@pytest.mark.parametrize(("target", "flags"), one_in(2, BUILDS))
def test_the_library_takes_over(
    target: str, flags: tuple[str, ...], tmp_path: Path
) -> None:
    q = np.array(
        [
            [1.0, 1e6, -1e22, 3.0],
            [np.nan, 1.0, 2.0, 3.0],
            [np.inf, 1.0, -np.inf, 0.5],
            [1e300, 0.0, 1.0, 2.0],
        ]
    )
    found = build(tmp_path, target, flags)(circle(), {"q": q})
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(
            found, np.stack([np.sin(q), np.cos(q)], axis=1), rtol=1e-15
        )
