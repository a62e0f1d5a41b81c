"""How generated source reads: golden files, hostile names, constants, and what is refused.

``ECHELON_UPDATE_GOLDENS=1 pytest tests/codegen/test_codegen_text.py`` writes the golden files
anew; read the difference.
"""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
from dataclasses import replace
from difflib import unified_diff
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.algebra.program.function import Argument, Function
from echelon.algebra.program.tape import Program
from echelon.cli.destination import MANIFEST
from echelon.cli.generate import FUNCTIONS as LISTED_FUNCTIONS
from echelon.cli.generate import LOOP_FUNCTIONS as LISTED_LOOP_FUNCTIONS
from echelon.cli.generate import TARGETS as LISTED_TARGETS
from echelon.codegen import TARGETS
from echelon.codegen.language import Precision
from echelon.codegen.source import Subject, generate, operations_text, printed
from echelon.codegen.views import view
from echelon.dynamics.functions import FUNCTIONS, LOOP_FUNCTIONS
from support import generated_code as generated
from support import textbook_arms as arms
from support.command_line import run
from support.paths import ROOT, TESTS
from support.selection import slow_unless
from support.system_tools import tool
from support.unchecked_names import unchecked_names

GOLDENS = TESTS / "goldens/codegen"
HOSTILE = (
    '*/ system("x")\n#if 0 \\ ??/ """ \'\'\' %} {{ 1/0 }} ${x} /* =# #= \u202e // \\'
)


@cache
def pendulum() -> ec.BaseModel:
    return ec.base_parameters(arms.double_pendulum())


def shown() -> list[Function]:
    """Functions recorded by hand, so that the goldens change with the printers only."""
    program = Program()
    q, qd, length = (
        program.input("q"),
        program.input("qd"),
        program.input("l1", "symbol"),
    )
    friction, mass = program.input("Fc1", "symbol"), program.input("M2", "symbol")
    arguments = (
        Argument("q", (q.node,), ("shoulder",), ("rad",), "joint positions"),
        Argument("qd", (qd.node,), ("shoulder",), ("rad/s",), "joint velocities"),
        Argument(
            "parameters",
            (mass.node, friction.node),
            ("M2", "Fc1"),
            ("kg", "N·m"),
            "dynamic parameters",
            True,
        ),
        Argument("symbols", (length.node,), ("l1",), ("SI",), "geometry", uniform=True),
    )
    arm = length * q.cos()
    force = (
        mass * arm * Fraction(981, 100)
        + friction * qd.sign()
        + (-arm + 1) * (arm - qd * qd) / 3
    )
    entries = {(0, 0): (q + q).sin().node, (1, 1): (-arm).node}
    labels = ("shoulder", "elbow")
    outputs = Function(
        "outputs",
        program,
        arguments,
        {(0,): force.node},
        (labels[:1],),
        ("N·m",),
        "measured outputs",
    )
    matrix = Function(
        "matrix",
        program,
        (arguments[0], arguments[3]),
        entries,
        (labels, labels),
        (),
        "a matrix",
    )
    return [outputs, matrix]


@pytest.mark.parametrize("target", TARGETS)
def test_golden(target: str) -> None:
    subject = Subject("shoulder", pendulum().expressions[:2], {"g": "9.81"})
    compare_goldens(
        printed(shown(), TARGETS[target], Precision.DOUBLE, "shoulder", subject)
    )


def test_golden_of_recursive_least_squares() -> None:
    matrix = replace(shown()[1], name="regressor")
    subject = Subject("shoulder", pendulum().expressions[:2], {"g": "9.81"})
    files = printed(
        [matrix], TARGETS["c"], Precision.SINGLE, "estimator", subject, estimates=True
    )
    compare_goldens(files)


def compare_goldens(files: dict[str, str]) -> None:
    for name, text in files.items():
        stable = text.replace(ec.__version__, "VERSION")
        path = GOLDENS / name
        if os.environ.get("ECHELON_UPDATE_GOLDENS"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(stable, encoding="utf-8", newline="\n")
        golden = path.read_text(encoding="utf-8")
        difference = "\n".join(
            unified_diff(
                golden.splitlines(), stable.splitlines(), "golden", name, lineterm=""
            )
        )
        assert not difference, f"\n{difference}"


@cache
def hostile() -> ec.BaseModel:
    """A pendulum whose robot, bodies and joints have names that try to leave comments."""
    robot = arms.double_pendulum()
    bodies = []
    for k, body in enumerate(robot.bodies):
        motions = tuple(replace(m, name=f"{HOSTILE}{k}") for m in body.joint.motions)
        steps = tuple(
            next(
                (
                    m
                    for m, old in zip(motions, body.joint.motions, strict=True)
                    if old == step
                ),
                step,
            )
            for step in body.joint.steps
        )
        bodies.append(
            replace(
                body,
                name=f"{HOSTILE}{k}",
                joint=replace(body.joint, name=HOSTILE, steps=steps),
            )
        )
    return ec.base_parameters(replace(robot, name=HOSTILE, bodies=tuple(bodies)))


@pytest.mark.parametrize("target", TARGETS)
def test_hostile_names_stay_in_comments(target: str, tmp_path: Path) -> None:
    with unchecked_names():
        source = generate(hostile(), target, ["inverse_dynamics"])
    robot = "system_x_if_0_1_0_x"
    assert all(robot in name for name in source)
    assert any("system(" in text for text in source.values())
    for name, text in source.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        assert "\u202e" not in text
        opening = TARGETS[target].comment.strip()
        assert all(
            line.lstrip().startswith(opening)
            for line in text.splitlines()
            if "system(" in line
        )
    if target in generated.RUNNERS:
        call = generated.RUNNERS[target](
            generated.Build(tmp_path, robot, source.functions, "double")
        )
        values = {
            a.name: np.full(len(a) if a.uniform else (1, len(a)), 0.5)
            for a in source.functions[0].arguments
        }
        np.testing.assert_allclose(
            call(source.functions[0], values),
            generated.reference(source.functions[0], values),
            rtol=1e-13,
        )


def test_parameters_become_constants(tmp_path: Path) -> None:
    base = pendulum()
    values = {name: 0.5 + k for k, name in enumerate(base.pivots)}
    plain, baked = (
        generate(base, "python", ["inverse_dynamics"], parameters=p)
        for p in (None, values)
    )
    (plain_function,), (baked_function,) = plain.functions, baked.functions
    assert "parameters" in {a.name for a in plain_function.arguments}
    assert "parameters" not in {a.name for a in baked_function.arguments}
    state = {
        name: np.random.default_rng(0).uniform(-2, 2, (5, 2))
        for name in ("q", "qd", "qdd")
    }
    wanted = generated.reference(
        plain_function, {**state, "parameters": np.array(list(values.values()))}
    )
    (tmp_path / "double_pendulum.py").write_text(baked["double_pendulum.py"])
    loaded = generated.python(
        generated.Build(tmp_path, "double_pendulum", baked.functions, "double")
    )
    np.testing.assert_allclose(loaded(baked_function, state), wanted, rtol=1e-12)
    standard = dict.fromkeys(base.parameters, 1.0)
    files = generate(base, "c", ["inverse_dynamics"], parameters=standard)
    assert (
        f"= {float(base.values(list(standard.values()))[0])!r}"
        in files["double_pendulum.h"]
    )


def test_no_mass_matrix_where_friction_follows_the_load() -> None:
    """The other functions are written by default, and their head says what is missing; asked for, it is refused."""
    base = ec.base_parameters(
        ec.load_setup(ROOT / "examples" / "logs" / "double_pendulum.yaml").mechanism
    )
    source = generate(base, "c", None)
    assert [function.name for function in source.functions] == [
        "regressor",
        "inverse_dynamics",
        "gravity",
    ]
    assert (
        "mass_matrix is left out: effect 'Fl1' is not linear"
        in source["double_pendulum.h"]
    )
    with pytest.raises(ec.InputError, match="effect 'Fl1' is not linear"):
        generate(base, "c", ["mass_matrix"])


def test_symbols_without_value_are_an_argument() -> None:
    robot = arms.double_pendulum()
    unknown = replace(
        robot,
        symbols={
            n: replace(s, value=None, exact=None) for n, s in robot.symbols.items()
        },
    )
    base = ec.base_parameters(unknown)
    source = generate(base, "c", ["regressor", "gravity", "mass_matrix"])
    taken = {
        f.name: [a.labels for a in f.arguments if a.name == "symbols"]
        for f in source.functions
    }
    symbols = [labels for found in taken.values() for labels in found]
    assert symbols
    assert all(labels == symbols[0] for labels in symbols)
    given = dict.fromkeys(symbols[0], 0.25)
    filled = generate(base, "c", ["regressor"], symbols=given)
    assert [a.name for a in filled.functions[0].arguments] == ["q", "qd", "qdd"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"target": "fortran"}, r"no target 'fortran' \(valid: c, cpp, cuda, python, "),
        ({"functions": ["nope"]}, r"no function 'nope' \(valid: inverse_dynamics, "),
        ({"functions": []}, "no function is asked for"),
        ({"precision": "half"}, r"no precision 'half' \(valid: double, single\)"),
        ({"name": "a b"}, "'a b' cannot be used as a name"),
        ({"name": "class"}, "'class' cannot be used"),
        ({"name": "_x"}, "'_x' cannot be used"),
        ({"parameters": "nowhere"}, "parameters are 'file' or values"),
        ({"parameters": {"ZZ1": 1.0}}, "values are missing for 'MX1'"),
        ({"parameters": {"odd": 1.0}}, "there are no parameters 'odd'"),
        ({"symbols": {"odd": 1.0}}, "'odd' is not a symbol"),
    ],
)
def test_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ec.InputError, match=message):
        generate(pendulum(), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("precision", slow_unless(["double"], ["double", "single"]))
def test_cuda_compiles(precision: str, tmp_path: Path) -> None:
    nvcc = tool("nvcc")
    source = generate(pendulum(), "cuda", list(FUNCTIONS), precision=precision)
    (tmp_path / "a.cu").write_text(source["double_pendulum.cu"])
    done = subprocess.run(
        [nvcc, "-ptx", "a.cu", "-o", "a.ptx"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "double_pendulum_regressor_kernel" in (tmp_path / "a.ptx").read_text()
    assert "#include" not in source["double_pendulum.cu"]


# -- the command -------------------------------------------------------------------------------------------------------


def test_command(tmp_path: Path) -> None:
    done = run(
        "generate",
        "examples/double_pendulum.yaml",
        "-o",
        str(tmp_path / "new/out"),
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in (tmp_path / "new/out").iterdir()) == [
        MANIFEST,
        "double_pendulum.c",
        "double_pendulum.h",
    ]
    assert re.search(
        r"^inverse_dynamics: \d+ additions, \d+ multiplications, ",
        done.stdout,
        re.MULTILINE,
    )


def test_command_with_a_saved_set_and_values(tmp_path: Path) -> None:
    saved, values = tmp_path / "saved.json", tmp_path / "values.csv"
    ec.save_base(pendulum(), saved)
    values.write_text(
        "name,value\n"
        + "".join(f"{name},{k}.5\n" for k, name in enumerate(pendulum().pivots))
    )
    target = tmp_path / "mine.py"
    options = [
        "--target",
        "python",
        "--function",
        "gravity",
        "--parameters",
        str(values),
        "--name",
        "arm",
        "--json",
    ]
    done = run("generate", str(saved), "-o", str(target), *options)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["files"] == [str(target)]
    assert summary["functions"]["gravity"]["arguments"] == {"q": 2}
    assert summary["functions"]["gravity"]["operations"]["sin"] >= 1
    ast.parse(target.read_text())
    refused = run("generate", str(saved), "-o", str(target), "--floating")
    assert refused.returncode == 2
    assert "options for reading or deriving do not apply" in refused.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1]", "expected {"),
        ('{"ZZ1": "x"}', "'ZZ1'"),
        ("a,b,c\n", "expected {"),
        ("ZZ1,1\nZZ1,2\n", "a name occurs twice"),
        ("", "values are missing"),
    ],
)
def test_command_refuses_odd_values(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "values").write_text(text)
    options = ["--parameters", str(tmp_path / "values"), "-o", str(tmp_path / "out")]
    done = run("generate", "examples/double_pendulum.yaml", *options, cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    assert not (tmp_path / "out").exists()


def test_command_refuses_a_file_for_several(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    done = run(
        "generate",
        "examples/double_pendulum.yaml",
        "-o",
        str(tmp_path / "taken"),
        cwd=ROOT,
    )
    assert done.returncode == 2
    assert "is not a directory" in done.stderr


def test_operations_are_counted_in_words() -> None:
    source = generate(ec.load("examples/double_pendulum.yaml"), "c", ["regressor"])
    text = operations_text(source.functions[0])
    assert text.split(", ")[-2:] == ["2 sin", "2 cos"]
    one = generate(
        ec.load("examples/double_pendulum.yaml"), "c", ["mass_matrix"]
    ).functions[0]
    assert "1 cos" in operations_text(one)


def test_names_are_as_long_as_a_language_allows() -> None:
    robot = replace(ec.load("examples/double_pendulum.yaml"), name="long " * 20)
    functions = ["inverse_dynamics_derivatives"]
    longest = max(len(Path(name).stem) for name in generate(robot, "matlab", functions))
    assert 50 < longest <= 63
    chosen = "a" * 60
    assert generate(robot, "c", functions, name=chosen)
    problem = "names in matlab have 63 letters, so that with the longest .* 34 are left"
    with pytest.raises(ec.InputError, match=problem):
        generate(robot, "matlab", functions, name=chosen)


def test_parts_know_the_names_that_they_define() -> None:
    base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
    shown = view(base.function("inverse_dynamics"), TARGETS["python"], Precision.DOUBLE)
    for part in shown.parts:
        defined = [line.split(" = ")[0] for line in part.lines if line[:3] != "out"]
        assert list(part.names) == defined
        assert defined


def test_help_lists_what_there_is() -> None:
    assert LISTED_TARGETS.split(", ") == list(TARGETS)
    for page in ("cli", "code-generation"):
        text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
        assert not [name for name in TARGETS if f"`{name}`" not in text], page
    assert not [
        name for name in TARGETS if f'``"{name}"``' not in str(generate.__doc__)
    ]
    assert set(LISTED_FUNCTIONS.split(", ")) == set(FUNCTIONS)
    assert set(LISTED_LOOP_FUNCTIONS.split(", ")) == set(LOOP_FUNCTIONS)
