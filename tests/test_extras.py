"""The core works alone, and whatever needs more is one line with the command that installs it."""

from __future__ import annotations

import ast
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from echelon.shared import __version__
from echelon.shared.extras import EXTRAS
from support.command_line import run_alone
from support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
MODULES = {module for modules in EXTRAS.values() for module in modules}
FROM_ANOTHER = {"xacro"}
"""Modules that a package with another name brings."""


def packages(requirements: list[str]) -> set[str]:
    """Names of packages as modules, those of other extras among them."""
    found: set[str] = set()
    for requirement in requirements:
        name, inner = re.fullmatch(
            r"([\w-]+)(?:\[([\w,]+)\])?[^\[]*", requirement
        ).groups()  # type: ignore[union-attr]
        if name == PROJECT["name"]:
            found |= {
                p
                for e in inner.split(",")
                for p in packages(PROJECT["optional-dependencies"][e])
            }
        else:
            found.add(name.replace("-", "_"))
    return found


@pytest.mark.parametrize("name", EXTRAS)
def test_an_extra_installs_what_is_imported_from_it(name: str) -> None:
    brought = packages(PROJECT["optional-dependencies"][name])
    assert set(EXTRAS[name]) - FROM_ANOTHER <= brought
    assert not set(EXTRAS[name]) & packages(PROJECT["dependencies"])


def test_the_recipe_installs_the_core() -> None:
    recipe = (ROOT / "packaging/recipe.yaml").read_text()
    listed = recipe.split("  run:\n")[1].split("tests:")[0].replace(" >=", ">=")
    assert re.findall(r"- (\S+)", listed) == [
        f"python{PROJECT['requires-python']}",
        *PROJECT["dependencies"],
    ]


# -- imports -----------------------------------------------------------------------------------------------------------


def optional_imports(
    node: ast.AST, inside: str | None = None
) -> Iterator[tuple[str, str | None, int]]:
    """Optional modules, the extra under which each is imported, and the line; those for type checking are left out."""
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return
    if (
        isinstance(node, ast.With)
        and (call := node.items[0].context_expr)
        and isinstance(call, ast.Call)
    ):
        inside = (
            ast.unparse(call.args[0]).strip("'")
            if ast.unparse(call.func) == "extra"
            else inside
        )
    if isinstance(node, ast.Import | ast.ImportFrom):
        names = (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [alias.name for alias in node.names]
        )
        yield from (
            (n, inside, node.lineno)
            for n in (name.partition(".")[0] for name in names)
            if n in MODULES
        )
    for child in ast.iter_child_nodes(node):
        yield from optional_imports(child, inside)


BARE = {
    ("csv_file.py", "pyarrow"),  # without it NumPy reads the file
    ("parquet_file.py", "pyarrow"),  # others import that module under the extra
    ("target.py", "llvmlite"),  # its version, when LLVM is there
}


def test_what_is_optional_is_imported_under_its_extra() -> None:
    wrong = [
        f"{path}:{line}: import of {module} under extra {name}"
        for path in (ROOT / "src/echelon").rglob("*.py")
        if any(
            f" {module}" in (text := path.read_text(encoding="utf-8"))
            for module in MODULES
        )
        for module, name, line in optional_imports(ast.parse(text))
        if (path.name, module) not in BARE
        and name != "needed_by"
        and module not in EXTRAS.get(name or "", ())
    ]
    assert not wrong


# -- the core alone ----------------------------------------------------------------------------------------------------

ALONE = f"""
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {MODULES!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
"""
"""Makes a process of its own one in which no extra is installed."""

COMMANDS = """
import contextlib, io, json
from echelon.cli import main
found = []
for line in json.loads(sys.argv[1]):
    out, err, code = io.StringIO(), io.StringIO(), 0
    sys.argv = ["echelon", *line]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    found.append([code, out.getvalue(), err.getvalue()])
print(json.dumps(found))
"""

PENDULUM, EXAMPLES = str(ROOT / "examples/double_pendulum.yaml"), ROOT / "examples"
CASES: list[tuple[str, str | None]] = [
    (f"derive {PENDULUM} --format json -o set.json", None),
    (f"derive {PENDULUM}", None),
    (f"derive {PENDULUM} --format latex", None),
    (f"derive {PENDULUM} --format markdown", None),
    (f"derive {PENDULUM} --numeric", None),
    (f"derive {EXAMPLES}/loops/four_bar.yaml", None),
    (f"derive {EXAMPLES}/linear/arrhenius.yaml", None),
    (f"derive {EXAMPLES}/so101.urdf --rank-only", None),
    ("verify set.json", None),
    (f"compare {EXAMPLES}/so101.urdf {EXAMPLES}/so101.urdf", None),
    (f"sensors {PENDULUM}", None),
    (f"audit {PENDULUM} set.json", None),
    *(
        (f"generate set.json -t {t} -o {t}", None)
        for t in ("c", "python", "casadi", "rust")
    ),
    *((f"schema {which}", None) for which in ("description", "base-model")),
    (f"derive {PENDULUM} --regressor latex", "symbolic"),
    (f"derive {EXAMPLES}/two_link.xml", "mjcf"),
    ("derive panda_description", "robots"),
    ("derive arm.urdf.xacro", "robots"),
    (f"setup {PENDULUM} log.csv", None),
    (f"check {PENDULUM} log.csv", "identify"),
    (f"check {PENDULUM} log.parquet", "identify"),
    (f"check {PENDULUM} log.h5", "identify"),
    (f"check {PENDULUM} log.mcap", "ros"),
    (f"check {PENDULUM} log.bag", "ros"),
    (f"identify {PENDULUM} log.csv -o result", "identify"),
    (f"identify {PENDULUM} log.csv -o result --dask 2", "dask"),
    (f"excite {PENDULUM} -o motion", "excite"),
    (f"check-trajectory {PENDULUM} motion.csv", "excite"),
]


@cache
def alone(folder: Path) -> dict[str, tuple[int, str, str]]:
    """Exit code, output and errors of each command, all in one process without extras."""
    t = np.arange(0.0, 8.0, 0.01)
    rows = np.column_stack(
        [t, *(np.sin((k + 1) * t + p) for k in range(2) for p in (0.0, 1.6, 3.1))]
    )
    names = "t,q_j1,qd_j1,tau_j1,q_j2,qd_j2,tau_j2"
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=names, comments="")
    np.savetxt(
        folder / "motion.csv",
        rows[:, [0, 1, 4]],
        delimiter=",",
        header="t,q_j1,q_j2",
        comments="",
    )
    for name, start in {
        "log.parquet": b"PAR1",
        "log.h5": b"\x89HDF\r\n\x1a\n",
        "log.bag": b"#ROSBAG V2.0\n",
    }.items():
        (folder / name).write_bytes(start * 20)
    (folder / "log.mcap").write_bytes(b"\x89MCAP0\r\n" * 20)
    xacro = '<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="x" value="1"/></robot>'
    (folder / "arm.urdf.xacro").write_text(xacro)
    lines = json.dumps([command.split() for command, _ in CASES])
    done = run_alone(lines, cwd=folder, code=ALONE + COMMANDS)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    return {
        command: tuple(answer)
        for (command, _), answer in zip(CASES, found, strict=True)
    }


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("alone")


@pytest.mark.parametrize(
    ("command", "name"),
    CASES,
    ids=[c.replace(f"{ROOT}/examples/", "") for c, _ in CASES],
)
def test_commands_work_with_the_core_or_name_the_extra(
    command: str, name: str | None, folder: Path
) -> None:
    code, out, err = alone(folder)[command]
    if name is None:
        assert (code, err) == (0, "")
        return
    assert (code, out) == (2, "")
    assert re.fullmatch(
        rf'echelon: this needs the package \'\w+\': install it with  pip install "echelon-robotics\[{name}\]"\n',
        err,
    )


PYTHON = """
import numpy as np, echelon as ec
for name in ec.__all__:
    getattr(ec, name)
base = ec.base_parameters(ec.load(sys.argv[1]))
q = np.linspace(0, 1, 10).reshape(5, 2)
print(base.regressor(q, q, q).shape, base.predict(q, q, q, np.ones(6)).shape)
for use in (lambda: base.B, lambda: base.accumulate({"q": q, "qd": q, "qdd": q, "y": q})):
    try:
        use()
    except ec.MissingExtraError as error:
        print(error)
"""


def test_the_library_alone() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ALONE + PYTHON, PENDULUM],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    first, *lines = done.stdout.splitlines()
    assert first == "(5, 2, 6) (5, 2)"
    assert [re.findall(r"\[\w+\]", line) for line in lines] == [
        ["[symbolic]"],
        ["[identify]"],
    ]


def test_workflows_name_files_that_exist() -> None:
    texts = [file.read_text() for file in (ROOT / ".github").rglob("*.yml")]
    named = re.findall(
        r"\b(?:src|packaging|site|benchmarks)/[\w/]+\.\w+", "".join(texts)
    )
    assert named
    assert [file for file in named if not (ROOT / file).is_file()] == []


def test_a_release_names_its_repository(tmp_path: Path) -> None:
    """Addresses and the recipe are filled in once, however often that is asked for."""
    for name in (
        "pyproject.toml",
        "CITATION.cff",
        "packaging/recipe.yaml",
        "packaging/release.py",
        "README.md",
        "src/echelon/shared/version.py",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        shutil.copy(ROOT / name, tmp_path / name)
    archive = tmp_path / "echelon_robotics-1.2.3.tar.gz"
    archive.write_bytes(b"source")

    def release(*words: str) -> subprocess.CompletedProcess[str]:
        program = [sys.executable, str(tmp_path / "packaging/release.py"), *words]
        return subprocess.run(program, capture_output=True, text=True, check=False)

    address = "https://github.com/somebody/echelon"
    assert [release("addresses", address).returncode for _ in range(2)] == [0, 0]
    urls = tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]["urls"]
    assert urls["Source"] == address
    readme = (tmp_path / "README.md").read_text()
    assert f"git clone {address} echelon && cd echelon\n" in readme
    links = re.findall(r"\]\(([^)\s]+)\)", readme)
    assert links
    assert all(link.startswith(("https://", "#")) for link in links)
    assert urls["Documentation"] == "https://somebody.github.io/echelon/"
    printed = "import version; print(version.page('assumptions'), version.__version__)"
    folder = tmp_path / "src/echelon/shared"
    said = subprocess.run([sys.executable, "-c", printed], cwd=folder, capture_output=True, text=True, check=True)  # fmt: skip
    page = "https://somebody.github.io/echelon/assumptions.html"
    assert said.stdout == f"{page} {__version__}\n"
    assert (
        yaml.safe_load((tmp_path / "CITATION.cff").read_text())["repository-code"]
        == address
    )
    assert release("recipe", str(archive)).returncode == 0
    recipe = yaml.safe_load((tmp_path / "recipe.yaml").read_text())
    assert recipe["source"]["url"].endswith("/echelon_robotics-1.2.3.tar.gz")
    assert recipe["source"]["sha256"] == hashlib.sha256(b"source").hexdigest()
    assert (recipe["context"]["version"], recipe["about"]["repository"]) == (
        "1.2.3",
        address,
    )
    assert release("addresses", "somewhere").stderr.startswith(
        "'somewhere' is no address of a repository"
    )
