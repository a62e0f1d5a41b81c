"""The command line as a user meets it: output, files, exit codes, and silence where it is due."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from echelon.base.saved.schema import BaseModelRecord
from echelon.cli.commands import app
from echelon.cli.destination import MANIFEST
from echelon.shared.record_schemas import file_schema
from support.command_line import run, run_alone
from support.paths import ROOT
from support.selection import slow_unless

PANDA, PENDULUM = (
    str(ROOT / "examples/panda.yaml"),
    str(ROOT / "examples/double_pendulum.yaml"),
)


def test_text() -> None:
    done = run("derive", PANDA)
    assert done.returncode == 0
    assert done.stderr == ""
    assert done.stdout.startswith(
        "panda: 43 base parameters of 70 standard parameters, 7 outputs\n"
    )
    assert (
        "\n16  XX4 − YY4 + YY5 + 2·d5·MZ5 − (a4² − d5²)·(M5 + M6 + M7)\n" in done.stdout
    )
    assert "certificate: rank 43" in done.stdout
    assert "\x1b" not in done.stdout


@pytest.mark.parametrize(
    ("name", "sign"),
    [("markdown", "| # | base parameter"), ("latex", r"\begin{align*}")],
)
def test_other_formats(name: str, sign: str) -> None:
    done = run("derive", PENDULUM, "--format", name)
    assert done.returncode == 0
    assert sign in done.stdout


def test_json_follows_its_schema_and_repeats() -> None:
    first, second = (
        run("derive", PANDA, "--json"),
        run("derive", PANDA, "--format", "json"),
    )
    assert first.stdout == second.stdout
    data = json.loads(first.stdout)
    jsonschema.Draft202012Validator(file_schema(BaseModelRecord)).validate(data)
    term = next(
        t for row in data["base"] for t in row["terms"] if t["coefficient"] == "a4^2"
    )
    assert term["value"] == pytest.approx(0.0825**2)


def test_seed_is_recorded_and_does_not_change_the_answer() -> None:
    one, two = (
        json.loads(run("derive", PENDULUM, "--json", "--seed", s).stdout)
        for s in ("1", "2")
    )
    assert (one["seed"], two["seed"]) == (1, 2)
    assert one["base"] == two["base"]


def test_options_reach_the_library() -> None:
    text = run("derive", PENDULUM, "--gravity", "none").stdout
    assert text.startswith("double pendulum: 4 base parameters")
    assert run("derive", PENDULUM, "--floating").stdout.startswith("double pendulum: 2")
    assert "M2 + (1/l1)·MX1" in run("derive", PENDULUM, "--prefer", "M2").stdout
    assert run("derive", PENDULUM, "--order", "tip-to-base").returncode == 0
    assert (
        "representatives: ZZ1 MX1 MY1 ZZ2 MX2 MY2"
        in run("derive", PENDULUM, "--rank-only").stdout
    )
    assert (
        json.loads(run("derive", PENDULUM, "--rank-only", "--json").stdout)["rank"] == 6
    )


def test_file_is_written_whole_and_verifies(tmp_path: Path) -> None:
    file = tmp_path / "out.json"
    written = run("derive", PANDA, "--json", "-o", str(file))
    assert (written.stdout, written.stderr) == (f"wrote {file}\n", "")
    assert {f.name for f in tmp_path.iterdir()} == {"out.json", MANIFEST}
    done = run("verify", str(file))
    assert (done.returncode, done.stdout.split(",")[0]) == (0, f"{file}: valid")
    assert json.loads(run("verify", str(file), "--json").stdout)["valid"] is True


def test_a_refuted_claim_has_exit_code_1(tmp_path: Path) -> None:
    file = tmp_path / "out.json"
    run("derive", PANDA, "--json", "-o", str(file))
    file.write_text(file.read_text().replace('"a4^2"', '"a4*d3"', 1))
    done = run("verify", str(file))
    assert done.returncode == 1
    assert "NOT valid" in done.stdout
    assert json.loads(run("verify", str(file), "--json").stdout)["valid"] is False


BAD = {
    "missing file": ("derive", "no.urdf"),
    "directory": ("derive", "."),
    "bad robot": ("derive", "bad.urdf"),
    "bad yaml": ("derive", "bad.yaml"),
    "bad gravity": ("derive", PENDULUM, "--gravity", "up"),
    "bad tolerance": ("derive", PENDULUM, "--snap-tolerance", "7"),
    "bad preference": ("derive", PENDULUM, "--prefer", "M99"),
    "unwritable": ("derive", PENDULUM, "-o", "nowhere/out.txt"),
    "verify nothing": ("verify", "no.json"),
    "verify garbage": ("verify", "bad.yaml"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path: Path, case: str) -> None:
    (tmp_path / "bad.urdf").write_text(
        "<robot><link name='a'/><link name='b'/></robot>"
    )
    (tmp_path / "bad.yaml").write_text("echelon: 1\nbodys: []\n")
    before = sorted(tmp_path.iterdir())
    done = run(
        *BAD[case],
        *([] if "-o" in BAD[case] or BAD[case][0] == "verify" else ["-o", "out.txt"]),
        cwd=tmp_path,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("echelon: ")
    assert done.stderr.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


IGNORED = [
    ("derive", PANDA, "--rank-only", *others)
    for others in (
        ("--prefer", "M7"),
        ("--order", "tip-to-base"),
        ("--format", "latex"),
        ("--format", "markdown"),
    )
]
"""Options that would have no effect are refused."""


@pytest.mark.parametrize(
    "arguments",
    [("derive",), ("derive", PANDA, "--nonsense"), ("frobnicate",), (), *IGNORED],
)
def test_usage_errors(arguments: tuple[str, ...]) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


def test_verbose_says_what_is_done_on_standard_error() -> None:
    quiet, verbose = run("derive", PENDULUM), run("derive", PENDULUM, "-v")
    assert (quiet.stderr, verbose.stdout) == ("", quiet.stdout)
    lines = verbose.stderr.splitlines()
    assert lines[0].endswith(" s  deriving double_pendulum.yaml")
    assert lines[-1].endswith(" s  deriving double_pendulum.yaml: certificate")


def test_traceback_on_request() -> None:
    assert "Traceback" not in run("derive", "no.urdf").stderr
    done = run("--traceback", "derive", "no.urdf")
    assert done.stderr.startswith("Traceback")
    assert done.returncode == 2


def test_our_own_mistakes_are_no_verdict() -> None:
    """A bug shows its traceback, and its exit code is not that of a refuted claim."""
    bug = "import echelon.base.saved.saved as s; s.load_set = lambda _: 1 // 0; from echelon.cli import main; main()"
    done = run_alone("verify", "set.json", code=bug)
    assert "ZeroDivisionError" in done.stderr
    assert done.returncode == 70


def test_interruption() -> None:
    stop = "import echelon.base.saved.saved as s\ndef stop(_): raise KeyboardInterrupt\ns.load_set = stop"
    done = run_alone(
        "verify", "set.json", code=f"{stop}\nfrom echelon.cli import main\nmain()"
    )
    assert (done.returncode, done.stdout, "Traceback" in done.stderr) == (
        130,
        "",
        False,
    )


def test_a_full_disk_is_one_line() -> None:
    full = Path("/dev/full")
    if not full.is_char_device():
        pytest.skip("no /dev/full on this system")
    code = "import os; os.dup2(os.open('/dev/full', os.O_WRONLY), 1); from echelon.cli import main; main()"
    done = run_alone("derive", PENDULUM, code=code)
    assert done.stderr.startswith("echelon: ")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


@pytest.mark.parametrize(
    "encoding", slow_unless(["ascii"], ["cp1252", "ascii", "utf-8"])
)
def test_pipes_get_utf8_on_every_system(encoding: str) -> None:
    assert (
        "1  ZZ1 + l1²·M2"
        in run_alone("derive", PENDULUM, PYTHONIOENCODING=encoding).stdout
    )


def test_a_reader_may_leave_early() -> None:
    code = "import os; r, w = os.pipe(); os.close(r); os.dup2(w, 1); from echelon.cli import main; main()"
    done = run_alone("derive", PENDULUM, code=code)
    assert (done.returncode, done.stderr) == (0, "")


def test_failure_leaves_an_existing_file_alone(tmp_path: Path) -> None:
    (tmp_path / "out.txt").write_text("precious")
    (tmp_path / "bad.yaml").write_text("echelon: 1\n")
    assert run("derive", "bad.yaml", "-o", "out.txt", cwd=tmp_path).returncode == 2
    assert (tmp_path / "out.txt").read_text() == "precious"
    (tmp_path / "folder").mkdir()
    assert run("derive", PENDULUM, "-o", "folder", cwd=tmp_path).returncode == 2
    assert sorted(f.name for f in tmp_path.iterdir()) == [
        "bad.yaml",
        "folder",
        "out.txt",
    ]


def test_errors_stay_one_line_whatever_the_names() -> None:
    done = run("derive", PENDULUM, "--prefer", "M\n\x1b[31m9")
    assert (done.returncode, done.stderr.count("\n"), "\x1b" in done.stderr) == (
        2,
        1,
        False,
    )


EXAMPLES = {
    command: epilog.removeprefix("Example: ")
    for command, (_, epilog) in app.functions.items()
}
"""The example at the end of the help of each command, in the order in which they can be run."""


@pytest.mark.parametrize("command", EXAMPLES)
def test_help_has_an_example_about_files_that_exist(command: str) -> None:
    assert command in run("--help").stdout
    done = run(command, "-h")
    assert done.returncode == 0
    example = EXAMPLES[command]
    assert f"Example: {example}" in " ".join(done.stdout.split())
    program, name, *arguments = shlex.split(example)
    assert (program, name) == ("echelon", command)
    given = [word for word in arguments if word.startswith(("examples/", "docs/"))]
    assert all((ROOT / file).is_file() for file in given)


@pytest.mark.slow
def test_examples_of_the_help_run(tmp_path: Path) -> None:
    for folder in ("examples", "docs"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    differs = ("audit", "compare")  # exit code 1
    for command, example in EXAMPLES.items():
        arguments = shlex.split(example.partition(" > ")[0])[1:]
        done = run(*arguments, cwd=tmp_path)
        assert done.returncode == (command in differs), (example, done.stderr)


@pytest.mark.parametrize(
    "which", ["description", "base-model", "identified", "trajectory", "calibration"]
)
def test_schemas(which: str) -> None:
    jsonschema.Draft202012Validator.check_schema(
        json.loads(run("schema", which).stdout)
    )


def test_version() -> None:
    assert run("--version").stdout.startswith("echelon 0.")


def loaded(code: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{code}\nprint(*{{m.partition('.')[0] for m in sys.modules}})"],
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT / "src")}, check=True,
    )  # fmt: skip
    return set(done.stdout.split())


def test_help_loads_next_to_nothing() -> None:
    show = "from echelon.cli import main\nsys.argv = ['echelon', '--help']\ntry: main()\nexcept SystemExit: pass"
    assert not loaded(show) & {"sympy", "pydantic", "mujoco", "scipy", "yaml", "rich"}


DERIVE = """
import io, sys
from contextlib import redirect_stdout
from echelon.cli import main
sys.argv = ["echelon", "derive", {robot!r}]
with redirect_stdout(io.StringIO()) as text:
    try:
        main()
    except SystemExit as ended:
        assert not ended.code
assert "43 base parameters of 70" in text.getvalue()
"""


def test_derive_loads_only_what_it_needs() -> None:
    """Half of the time that a person waits for a small robot is imports."""
    found = loaded(DERIVE.format(robot=PANDA))
    assert {"click", "flint", "numpy", "yaml"} <= found
    others = "pydantic pydantic_core typer rich jinja2 sympy scipy mujoco pyarrow llvmlite plotly"
    assert not found & {*others.split(), "xml", "email"}


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("echelon der", "plain,derive"),
        ("echelon derive --rank", "plain,--rank-only"),
        ("echelon derive --format mark", "plain,markdown"),
        ("echelon derive pan", "file,pan"),
    ],
)
def test_shells_complete_commands_options_and_files(words: str, found: str) -> None:
    code = "import sys; sys.argv[0] = 'echelon'; from echelon.cli import main; main()"
    asked = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    done = run_alone(code=code, _ECHELON_COMPLETE="bash_complete", **asked)
    assert (done.returncode, done.stdout) == (0, f"{found}\n")


def test_help_knows_no_types_of_python() -> None:
    words = {"TEXT", "INTEGER", "FLOAT", "PATH", "<str>", "list["}
    for command in app.functions:
        assert not [word for word in words if word in run(command, "-h").stdout]


def test_a_command_is_built_alone() -> None:
    """The parameters of the others are not even looked at."""
    code = """
import echelon.cli.app as app
built = []
make = app._built
app._built = lambda name, *more: built.append(name) or make(name, *more)
sys.argv = ["echelon", "schema", "comparison"]
from echelon.cli import main
try: main()
except SystemExit: pass
assert built == ["schema"], built
"""
    loaded(code)


def test_import_is_light() -> None:
    assert not loaded("import echelon") & {
        "sympy",
        "pydantic",
        "rich",
        "click",
        "mujoco",
        "yaml",
        "scipy",
    }
