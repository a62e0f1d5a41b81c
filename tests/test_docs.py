"""The examples of README and docs are run, and must print what stands there."""

from __future__ import annotations

import doctest
import re
import shlex
from pathlib import Path
from string import Template

import pytest

from support.command_line import run
from support.explorer import module

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


LONG = (
    "docs/robots-with-loops.md-1",
    "docs/closed-loops.md-1",
    "docs/closed-loops.md-2",
    "docs/real-states.md-3",
    "docs/experiments.md-5",
)
"""Examples that take more than a second."""


def blocks(language: str) -> list[object]:
    found = []
    for page in PAGES:
        for k, (kind, body) in enumerate(FENCE.findall(page.read_text())):
            if kind == language:
                name = f"{page.relative_to(ROOT)}-{k}"
                marks = [pytest.mark.slow] * (name in LONG)
                found.append(pytest.param(body, id=name, marks=marks))
    return found


@pytest.mark.parametrize("block", blocks("console"))
def test_console_example(block: str) -> None:
    for command, expected in re.findall(
        r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.MULTILINE
    ):
        program, *arguments = shlex.split(command)
        assert program == "echelon"
        done = run(*arguments, cwd=ROOT)
        actual = done.stdout + done.stderr
        assert doctest.OutputChecker().check_output(expected, actual, FLAGS), (
            f"{command} printed:\n{actual}"
        )


@pytest.mark.parametrize("block", blocks("python"))
def test_python_example(block: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    test = doctest.DocTestParser().get_doctest(block, {}, "docs", None, 0)
    assert test.examples, "a python block is a session with >>>"
    results = doctest.DocTestRunner(optionflags=FLAGS, verbose=False).run(test)
    assert results.failed == 0


@pytest.mark.slow
def test_the_commands_of_readme_work_as_they_stand(tmp_path: Path) -> None:
    """All but the installation, and the search for a motion, which takes a minute."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    lines = [
        line
        for kind, body in FENCE.findall((ROOT / "README.md").read_text())
        if kind == "sh"
        for line in body.splitlines()
    ]
    names = dict(line.split("=") for line in lines if re.match(r"[A-Z]+=", line))
    commands = [
        shlex.split(Template(line).substitute(names), comments=True)
        for line in lines
        if line.startswith("echelon ")
    ]
    tried = [
        command for command in commands if "examples/excite/ur10.yaml" not in command
    ]
    assert {command[1] for command in tried} == {
        "derive",
        "verify",
        "generate",
        "identify",
        "predict",
    }
    for _, *arguments in tried:
        done = run(*arguments, cwd=tmp_path)
        assert done.returncode == 0, (arguments, done.stderr)


def test_numbers_come_from_the_benchmark() -> None:
    table = (ROOT / "benchmarks/results/bench.md").read_text()
    quoted = re.search(
        r"<!-- bench -->\n(.*?)<!-- /bench -->",
        (ROOT / "docs/speed.md").read_text(),
        re.DOTALL,
    )
    assert quoted is not None
    assert all(line in table for line in quoted[1].splitlines())


def test_ratios_of_readme_come_from_the_benchmark() -> None:
    """Ratios, counts and versions in the table of other tools."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    bench = (ROOT / "benchmarks/results/bench.md").read_text(encoding="utf-8")
    counts = (ROOT / "benchmarks/results/counts.md").read_text(encoding="utf-8")

    def ratio(row: str) -> float:
        return float(re.search(rf"\| {re.escape(row)} \| ([\d.]+)×", bench)[1])

    def middle(row: str) -> float:
        found = re.search(rf"\| {re.escape(row)} \| [\d.]+ / ([\d.]+) /", bench)
        return float(found[1])

    reused = "UR10, dense base W from Python : "
    pinocchio = ratio(f"{reused}Pinocchio C++, 1 thread")
    figaroh = ratio(f"{reused}FIGAROH, 1 thread")
    called = ratio("UR10, a call of generated C : Pinocchio C++ RNEA")
    like = middle("dense standard W, reused `out` : Pinocchio C++ into W, 1 thread")
    fresh = middle("dense base W, a fresh array : Pinocchio C++ into W, 1 thread")
    assert f"{int(pinocchio)} times faster into a reused array, equal into" in readme
    assert f"{figaroh / pinocchio:.1f} times slower" in readme
    assert f"{called:.0f} times faster" in readme
    assert f"{like:.0f} times faster than Pinocchio" in readme
    assert fresh == pytest.approx(1, abs=0.05)
    linkages = bench[bench.index("## Linkages") : bench.index("## Serial chains")]
    rows = [line for line in linkages.splitlines() if line.count(" ms") > 2]
    wrong = [line for line in rows if "**" in line]
    assert f"wrong for {len(wrong)} of {len(rows)}" in readme
    assert "| so100 | 36 | 38 | 38 |" in counts
    versions = (f"Pinocchio {re.search(r'pin ([0-9.]+)', bench)[1]}", "FIGAROH 1.0.2")
    assert all(version in readme for version in versions)
    assert versions[1] in counts


@pytest.mark.parametrize("page", ["docs/measured-robots.md"])
def test_numbers_come_from_the_real_logs(page: str) -> None:
    results = (ROOT / "benchmarks/results/real_logs.md").read_text().splitlines()
    quoted = re.search(
        r"<!-- real logs -->\n(.*?)<!-- /real logs -->",
        (ROOT / page).read_text(),
        re.DOTALL,
    )
    assert quoted is not None
    lines = [line for line in quoted[1].splitlines() if line]
    assert len(lines) > 6
    assert [line for line in lines if line not in results] == []


@pytest.mark.parametrize("page", ["docs/excitation.md"])
def test_numbers_come_from_the_benchmark_of_trajectories(page: str) -> None:
    results = (ROOT / "benchmarks/results/excitation.md").read_text().splitlines()
    quoted = re.search(
        r"<!-- excitation -->\n(.*?)<!-- /excitation -->",
        (ROOT / page).read_text(),
        re.DOTALL,
    )
    assert quoted is not None
    lines = [line for line in quoted[1].splitlines() if line]
    assert len(lines) > 6
    assert [line for line in lines if line not in results] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_pictures_are_those_of_this_program(tmp_path: Path) -> None:
    """``python site/pictures.py`` draws them again."""
    module("rooms_picture", "rooms_picture.py")
    module("elastic_picture", "elastic_picture.py")
    module("adaptive_picture", "adaptive_picture.py")
    module("pictures", "pictures.py").write(tmp_path)
    kept = {
        picture.name: picture.read_text(encoding="utf-8")
        for picture in (ROOT / "docs/pictures").iterdir()
    }
    assert {
        picture.name: picture.read_text(encoding="utf-8")
        for picture in tmp_path.iterdir()
    } == kept


def test_the_map_of_contributing_leads_to_files() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text[text.index("| where is") : text.index("## Rooms and doors")]
    named = re.findall(r"`([a-z_]+/[a-z_/]*(?:\.py)?|[a-z_]+\.py)`", table)
    assert len(named) > 25
    assert [
        path
        for path in named
        if not ((ROOT / "src/echelon" / path).exists() or (ROOT / path).exists())
    ] == []
