"""The zoo on small robots: its files, numbers, escaping, and that it goes on where it stopped."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

import pytest

import echelon as ec
from robot_zoo.build import build_zoo, write_index
from robot_zoo.exhibit import Found, ZooTask, build_exhibit, robot_files
from support.hostile_robot import HOSTILE, NAME
from support.paths import ROOT
from support.report_data import Page

SEARCHED = os.pathsep.join((str(ROOT / "src"), str(ROOT / "site")))
PENDULUM = (ROOT / "examples/double_pendulum.yaml").read_text(encoding="utf-8")


@pytest.fixture
def robots(tmp_path: Path) -> Path:
    folder = tmp_path / "robots"
    (folder / "one_description/urdf").mkdir(parents=True)
    (folder / "one_description/urdf/arm.urdf").write_text(HOSTILE, encoding="utf-8")
    (folder / "arm.yaml").write_text(PENDULUM, encoding="utf-8")
    (folder / "broken.urdf").write_text(
        "<robot name='b'><link/></robot>", encoding="utf-8"
    )
    (folder / "notes.yaml").write_text("just: notes", encoding="utf-8")
    (folder / "scene.xml").write_text(
        "<mujoco><include file='arm.xml'/></mujoco>", encoding="utf-8"
    )
    return folder


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robot_zoo", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": SEARCHED}
    return subprocess.run(command, env=environment, capture_output=True, text=True)


def test_files_are_found_and_named(robots: Path) -> None:
    assert [(f.place, f.slug) for f in robot_files([robots])] == [
        ("arm.yaml", "arm"),
        ("broken.urdf", "broken"),
        ("one_description/urdf/arm.urdf", "one-arm"),
    ]


def exhibit(
    path: Path, folder: Path, floating: bool = False
) -> tuple[dict[str, object], str]:
    task = ZooTask(Found(path, path.name, "robot"), floating, folder)
    row = build_exhibit(task)
    assert row is not None
    assert task.finished() == row
    return row, (folder / task.slug / "index.html").read_text(encoding="utf-8")


def test_coefficients_beyond_meaning_are_a_doubt(tmp_path: Path) -> None:
    """Here of a pendulum with links of 100,000 km; the index marks it, too."""
    (tmp_path / "arm.yaml").write_text(
        re.sub(r"l1: [0-9.]+", "l1: 1e8", PENDULUM), encoding="utf-8"
    )
    with pytest.warns(ec.DoubtWarning, match="millimetres"):
        row, html = exhibit(tmp_path / "arm.yaml", tmp_path)
    doubt = next(doubt for doubt in row["doubts"] if doubt.startswith("Coefficients"))
    assert doubt.startswith("Coefficients are as large as 1e+16")
    assert doubt in html
    write_index(tmp_path, [row])
    assert ">in doubt</span>" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_numbers_are_those_of_derive(tmp_path: Path) -> None:
    path = ROOT / "examples/rx90.yaml"
    row, html = exhibit(path, tmp_path)
    base = ec.base_parameters(ec.load(path))
    assert (row["rank"], row["standard"], row["bodies"]) == (
        base.rank,
        len(base.parameters),
        6,
    )
    folder = tmp_path / "robot"
    assert ec.load_base(folder / "set.json").pivots == base.pivots
    assert (folder / "base.tex").read_text(encoding="utf-8").count("&=") == base.rank
    assert {file.suffix for file in folder.iterdir()} == {
        ".json",
        ".tex",
        ".c",
        ".h",
        ".py",
        ".html",
    }
    assert len(re.findall(r'<td class="(?:alone|combined|unseen)"', html)) == len(
        base.parameters
    )
    buttons = [
        attributes["data-latex"]
        for tag, attributes in Page(html).elements
        if "data-latex" in attributes
    ]
    assert sum("align*" not in text for text in buttons) == base.rank
    assert str(base.certificate) in html


def test_names_of_files_cannot_become_markup(robots: Path, tmp_path: Path) -> None:
    row, html = exhibit(robots / "one_description/urdf/arm.urdf", tmp_path / "zoo")
    assert row["name"] == NAME
    write_index(tmp_path / "zoo", [row, {**row, "failed": NAME}])
    for text in (html, (tmp_path / "zoo/index.html").read_text(encoding="utf-8")):
        page = Page(text)
        assert len(page.scripts) == 1
        assert not [
            tag for tag, _ in page.elements if tag in ("img", "iframe", "object")
        ]
        handlers = {
            name
            for _, attributes in page.elements
            for name in attributes
            if name.startswith("on")
        }
        assert handlers <= {"onsubmit"}
        for _, attributes in page.elements:
            assert not re.match(
                "https?:|javascript:|//",
                attributes.get("href") or attributes.get("src") or "",
            )


@pytest.mark.parametrize(
    "joint", ["", "<freejoint/>", "<joint type='slide' axis='0 0 1'/>"]
)
def test_a_base_that_moves_is_not_floated(joint: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.xml" if joint else ROOT / "examples/floating_tree.yaml"
    if joint:
        arm = (
            "<body><joint/><inertial pos='0 0 1' mass='1' diaginertia='1 1 1'/></body>"
        )
        path.write_text(
            f"<mujoco><worldbody><body>{joint}<geom size='1'/>{arm}</body></worldbody></mujoco>"
        )
    assert (
        build_exhibit(ZooTask(Found(path, path.name, "robot"), True, tmp_path)) is None
    )


def test_a_coupling_to_an_absent_joint_is_a_fault(tmp_path: Path) -> None:
    text = (ROOT / "examples/so101.urdf").read_text(encoding="utf-8")
    path = tmp_path / "robot.urdf"
    path.write_text(
        text.replace("<limit ", '<mimic joint="none"/><limit ', 1), encoding="utf-8"
    )
    row, html = exhibit(path, tmp_path)
    problem = "it follows joint 'none', which does not exist"
    assert [
        fault["problem"] for fault in row["faults"] if fault["matters"] is None
    ] == [problem]  # type: ignore[attr-defined]
    assert (
        row["rank"] == ec.base_parameters(ec.load(path, independent_mimics=True)).rank
    )
    assert html.count("which does not exist") == 1


@pytest.mark.slow
def test_what_is_there_is_left_alone_and_failures_are_listed(
    robots: Path, tmp_path: Path
) -> None:
    zoo = tmp_path / "zoo"
    first = build_zoo(zoo, [robots], jobs=2)
    assert [(row["slug"], "failed" in row) for row in first] == [
        ("arm", False), ("broken", True), ("broken-floating", True), ("one-arm", False), ("one-arm-floating", False),
    ]  # fmt: skip
    index = (zoo / "index.html").read_text(encoding="utf-8")
    assert "broken.urdf" in index
    page = zoo / "one-arm/index.html"
    os.utime(page, (1, 1))
    second = build_zoo(zoo, [robots], only="one*")
    assert [row["slug"] for row in second] == ["one-arm", "one-arm-floating"]
    assert page.stat().st_mtime == 1
    assert (
        json.loads((zoo / "zoo.json").read_text(encoding="utf-8"))["robots"][0]["slug"]
        == "arm"
    )
    robots.joinpath("one_description/urdf/arm.urdf").write_text(
        HOSTILE + "<!-- new -->", encoding="utf-8"
    )
    build_zoo(zoo, [robots], only="one*")
    assert page.stat().st_mtime > 1


def test_a_robot_that_takes_too_long_is_given_up(robots: Path, tmp_path: Path) -> None:
    rows = build_zoo(tmp_path / "zoo", [robots], only="arm", seconds=0.001)
    assert rows[0]["failed"] == "not done within 0.001 s"


def test_a_build_that_was_stopped_goes_on(robots: Path, tmp_path: Path) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    zoo = tmp_path / "zoo"
    with pytest.raises(KeyboardInterrupt):
        build_zoo(zoo, [robots], only="arm", progress=stop)
    done = run(zoo, "--from", robots, "--only", "arm")
    assert done.returncode == 0, done.stderr


def test_equal_files_give_equal_bytes(robots: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        build_zoo(tmp_path / name, [robots], only="arm")
    first, second = (
        {
            file.relative_to(tmp_path / name): file.read_bytes()
            for file in (tmp_path / name).rglob("*.*")
        }
        for name in ("a", "b")
    )
    assert first == second


def test_pages_of_a_site_lead_to_its_explorer(robots: Path, tmp_path: Path) -> None:
    pages = {}
    for path, floating in (
        (robots / "arm.yaml", False),
        (robots / "one_description/urdf/arm.urdf", True),
    ):
        task = ZooTask(Found(path, path.name, path.stem), floating, tmp_path, "../")
        row = build_exhibit(task)
        assert row is not None
        write_index(tmp_path, [row], "../")
        pages[path.name] = [
            (tmp_path / name).read_text(encoding="utf-8")
            for name in (f"{task.slug}/index.html", "index.html")
        ]
    address = "../explorer/index.html#robot=arm."
    assert f'href="../{address}yaml"' in pages["arm.yaml"][0]
    assert f'href="{address}urdf&amp;floating=yes"' in pages["arm.urdf"][1]
    assert 'href="../../index.html"' in pages["arm.yaml"][0]


@pytest.mark.slow
def test_the_command_says_what_was_built(robots: Path, tmp_path: Path) -> None:
    folder = tmp_path / "zoo"
    done = run(folder, "--from", robots, "--only", "arm*", "--jobs", 1)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith(f"robots in {folder}, 0 without an answer\n")
    failed = run(folder, "--from", robots, "--only", "broken", "--jobs", 1)
    assert (failed.returncode, failed.stdout.split(":")[0]) == (1, "broken.urdf")
    assert run(robots, "--from", robots).returncode == 2
    missing = run(
        tmp_path / "other", "--from", robots, "--only", "nothing", "--jobs", 1
    )
    assert (missing.returncode, "no robot file matches" in missing.stderr) == (2, True)


@pytest.mark.skipif(os.name != "posix", reason="processes are found in /proc")
def test_workers_end_quietly_with_the_process_that_started_them(tmp_path: Path) -> None:
    """Also where it is killed, so that nobody can tell them, in the middle of a long derivation."""
    script = f"""
import time
from pathlib import Path
import robot_zoo.build as zoo
if __name__ == "__main__":
    zoo.build_zoo(Path({str(tmp_path / "zoo")!r}), [Path({str(tmp_path / "robots")!r})], jobs=2)
"""
    (tmp_path / "robots").mkdir()
    rows = "".join(
        f"  - {{joint: revolute, alpha: a{k}, a: b{k}, d: c{k}}}\n" for k in range(14)
    )
    symbols = ", ".join(
        f"{letter}{k}: 0.{k + 1}7" for k in range(14) for letter in "abc"
    )
    for name in ("one", "two"):
        text = f"echelon: 1\nname: {name}\nsymbols: {{{symbols}}}\nmodified_dh:\n{rows}"
        (tmp_path / "robots" / f"{name}.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    environment = {
        **os.environ,
        "PYTHONPATH": SEARCHED,
        "ECHELON_TEST_MARK": tmp_path.name,
    }
    with (tmp_path / "said").open("wb") as said:
        parent = subprocess.Popen(
            [sys.executable, tmp_path / "script.py"],
            env=environment,
            stdout=said,
            stderr=said,
        )
    assert eventually(
        lambda: len(marked(tmp_path.name)) >= 3
    )  # with two workers, and servers of the library
    sleep(1)
    parent.kill()
    parent.wait()
    assert eventually(lambda: not marked(tmp_path.name))
    assert (tmp_path / "said").read_text() == ""


def marked(mark: str) -> list[str]:
    """Processes whose environment holds a mark."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (
                f"ECHELON_TEST_MARK={mark}\0".encode()
                in (folder / "environ").read_bytes()
            ):
                found.append(folder.name)
    return found


def eventually(true: Callable[[], bool], seconds: float = 20) -> bool:
    until = monotonic() + seconds
    while not true() and monotonic() < until:
        sleep(0.05)
    return true()
