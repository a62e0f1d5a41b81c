"""The explorer: changes against files with the same change written into them, and visits in a browser."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_zoo.build import build_zoo
from support.command_line import run
from support.devtools import DevTools
from support.explorer import Explorer, Step, answers, module, serving
from support.hostile_robot import HOSTILE
from support.paths import EXAMPLES, ROOT
from support.site_audit import DARK, LIGHT, PHONE, audit, complaints
from support.system_tools import tool

PANDA, ARM = EXAMPLES / "panda.yaml", EXAMPLES / "so101.urdf"
Answer = dict[str, Any]


def derived(file: Path, *options: str) -> Answer:
    """Output of ``echelon derive``: the first line, and the closed forms without their numbers."""
    parts = run("derive", file.name, *options, cwd=file.parent).stdout.split("\n\n")
    return {
        "headline": parts[0],
        "forms": [line.split(maxsplit=1)[1] for line in parts[1].splitlines()],
    }


def asked(file: Path, **changes: Any) -> Answer:
    """The worker's answer to a request with changes."""
    request = {"name": file.name, "text": file.read_text(), "changes": changes}
    reply: Answer = json.loads(answers().answer(json.dumps(request)))
    return reply


def counted(reply: Answer) -> Answer:
    """The part of a reply that the command prints, too."""
    return {
        "headline": reply["headline"],
        "forms": [form["text"] for form in reply["forms"]],
    }


# -- changes, and files with the same change written into them ---------------------------------------------------------


def _locked(robot: Answer) -> None:
    robot["modified_dh"][2] |= {"joint": "fixed", "separate": True}


def _without_a4(robot: Answer) -> None:
    del robot["symbols"]["a4"]
    for row in robot["modified_dh"]:
        row.pop("a", None) if "a4" in str(row.get("a")) else None


def _d5_as_d3(robot: Answer) -> None:
    del robot["symbols"]["d5"]
    robot["modified_dh"][4]["d"] = "d3"


def _with_payload(robot: Answer) -> None:
    row = {
        "joint": "fixed",
        "label": "L",
        "name": "payload",
        "parent": "j7",
        "separate": True,
    }
    robot["modified_dh"].append(row)


def _on_the_base(robot: Answer) -> None:
    robot["outputs"] = [{"wrench": "base"}]


def _at_the_wrist(robot: Answer) -> None:
    robot["outputs"] = [{"joint": "all"}, {"wrench": "j7"}]


def _with_friction(robot: Answer) -> None:
    robot["effects"] = [
        {"type": kind, "at": "all"} for kind in ("viscous", "rotor_inertia")
    ]


EDITS: dict[str, tuple[Answer, Callable[[Answer], None]]] = {
    "a joint is held": ({"locked": ["j3"]}, _locked),
    "a length is zero": ({"zero": ["a4"]}, _without_a4),
    "two lengths are equal": ({"equal": [["d3", "d5"]]}, _d5_as_d3),
    "a payload": ({"payload": "j7"}, _with_payload),
    "the wrench under the base": ({"sensors": ["base"]}, _on_the_base),
    "joints and wrist": ({"sensors": ["joints", "j7"]}, _at_the_wrist),
    "a wrist beside the file's": ({"sensors": ["file", "j7"]}, _at_the_wrist),
    "friction and rotors": ({"effects": ["viscous", "rotor_inertia"]}, _with_friction),
}
OPTIONS: dict[str, tuple[Answer, list[str]]] = {
    "as it is": ({}, []),
    "no gravity": ({"gravity": "none"}, ["--gravity", "none"]),
    "a tilted base": ({"gravity": "0,3,-9"}, ["--gravity", "0,3,-9"]),
    "a floating base": ({"floating": True}, ["--floating"]),
    "other representatives": (
        {"prefer": ["M7"], "order": "tip-to-base"},
        ["--prefer", "M7", "--order", "tip-to-base"],
    ),
}


@pytest.mark.parametrize("case", EDITS)
def test_a_change_is_the_same_file_edited(case: str, tmp_path: Path) -> None:
    assert counted(asked(PANDA, **EDITS[case][0])) == edited(case, tmp_path)


@pytest.mark.parametrize("case", OPTIONS)
def test_a_change_is_an_option_of_the_command(case: str) -> None:
    changes, options = OPTIONS[case]
    assert counted(asked(PANDA, **changes)) == derived(PANDA, *options)


KEPT = {"gravity": "file", "locked": [], "payload": "", "sensors": []}


def both(folder: Path) -> Answer:
    """Output of ``echelon derive`` for an arm on a table and on a wall."""
    robot = yaml.safe_load(PANDA.read_text())
    robot["experiments"] = [{"name": "e1"}, {"name": "e2", "gravity": [9.81, 0, 0]}]
    file = folder / "panda.yaml"
    file.write_text(yaml.safe_dump(robot))
    return derived(file)


def test_two_experiments_are_those_of_a_file(tmp_path: Path) -> None:
    reply = asked(PANDA, beside=[json.dumps(KEPT)], gravity="9.81,0,0")
    assert counted(reply) == both(tmp_path)
    assert (reply["rank"], reply["picture"]["parents"][:2]) == (45, [-1, 0])


def test_a_second_experiment_tells_a_load_from_its_link() -> None:
    reply = asked(PANDA, beside=[json.dumps(KEPT)], payload="j7")
    assert reply["rank"] == 53
    assert asked(PANDA, beside=[json.dumps(KEPT)])["rank"] == 43
    refused = asked(PANDA, beside=[json.dumps(KEPT)], gravity="none")
    assert "choose a direction of gravity" in refused["error"]


def test_joint_torques_of_a_floating_arm_see_ten_fewer() -> None:
    assert (
        asked(PANDA, floating=True)["rank"]
        - asked(PANDA, floating=True, sensors=["joints"])["rank"]
        == 10
    )
    assert (
        asked(PANDA, floating=True)["rank"]
        == asked(PANDA, floating=True, sensors=["base"])["rank"]
    )


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        (
            {"zero": ["a9"]},
            "echelon: there is no length 'a9' (valid: d1, d3, a4, d5, a7)",
        ),
        (
            {"payload": "hand"},
            "echelon: there is no link 'hand' (valid: j1, j2, j3, j4, j5, j6, j7)",
        ),
        ({"gravity": "1,2"}, "echelon: panda.yaml: gravity is three numbers"),
        ({"locked": ["j9"]}, "echelon: there is no coordinate 'j9' to hold"),
    ],
)
def test_changes_that_do_not_fit_are_refused(changes: Answer, problem: str) -> None:
    assert asked(PANDA, **changes)["error"].startswith(problem)


@pytest.mark.parametrize(
    "text",
    ["echelon: 1\nname: x\nmodified_dh:\n- {joint: revolut}\n", "a: [", "", "<robot"],
)
@pytest.mark.parametrize("name", ["x.yaml", "x.urdf"])
def test_bad_files_give_the_line_of_the_command(
    name: str, text: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    assert asked(tmp_path / name)["error"] == run(
        "derive", name, cwd=tmp_path
    ).stderr.rstrip("\n")


def test_models_of_mujoco_are_refused_in_one_line() -> None:
    """No browser has MuJoCo, which reads them."""
    there = 'on a computer: pip install "echelon-robotics[mjcf]", then echelon derive two_link.xml'
    line = f"MJCF is read by MuJoCo, which no browser has; {there}"
    assert asked(EXAMPLES / "two_link.xml")["error"] == f"echelon: two_link.xml: {line}"


def test_xacro_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf.xacro").write_text(
        '<robot xmlns:xacro="http://ros.org/wiki/xacro" name="a"><xacro:link name="b"/></robot>'
    )
    line = "the explorer does not read xacro; on a computer: xacro arm.urdf.xacro > robot.urdf, then drop robot.urdf here"
    assert (
        asked(tmp_path / "arm.urdf.xacro")["error"]
        == f"echelon: arm.urdf.xacro: {line}"
    )


def test_downloads_are_what_the_commands_write(tmp_path: Path) -> None:
    def written(kind: str) -> dict[str, str]:
        request = {
            "name": "panda.yaml",
            "text": PANDA.read_text(),
            "changes": {},
            "file": kind,
        }
        files: dict[str, str] = json.loads(answers().answer(json.dumps(request)))[
            "files"
        ]
        return files

    for kind, name in (("json", "set.json"), ("latex", "set.tex")):
        text = run("derive", "panda.yaml", "--format", kind, cwd=EXAMPLES).stdout
        assert {file: text.rstrip() for file, text in written(kind).items()} == {
            name: text.rstrip()
        }
    run("generate", "panda.yaml", "--output", str(tmp_path), cwd=EXAMPLES)
    files = {file.name: file.read_text() for file in tmp_path.iterdir()}
    del files[".echelon.json"]  # the manifest of the folder
    assert written("c") == files


# -- visits ------------------------------------------------------------------------------------------------------------

Visit = Callable[..., list[Answer]]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built page, without Python, and a zoo that knows one robot of it."""
    tool("npm")
    folder = tmp_path_factory.mktemp("site")
    public = tmp_path_factory.mktemp("public")
    (public / "arm.urdf").write_text(ARM.read_text())
    build_zoo(folder / "zoo", [public], site="../")
    builder = module("build_explorer", "build_explorer.py")
    builder.build_page(
        folder / "explorer", [EXAMPLES], ROOT / "build" / "cache", [public]
    )
    return folder


@pytest.fixture(scope="module")
def explorer(
    page: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Explorer]:
    """One browser for all visits."""
    with (
        serving(page, pyodide=False) as port,
        DevTools(tmp_path_factory.mktemp("profile")) as browser,
    ):
        yield Explorer(browser, port)


@pytest.fixture
def visit(explorer: Explorer) -> Visit:
    """A visit: what the page says at first and after every step."""
    return explorer.visit


@cache
def told(file: Path, *options: str) -> Answer:
    """As :func:`derived`, once."""
    return derived(file, *options)


def seen(state: Answer) -> Answer:
    """The part of what a page says that the command prints, too."""
    assert state["error"] == ""
    return {"headline": state["headline"], "forms": state["forms"]}


@pytest.mark.slow
def test_a_first_visit(visit: Visit) -> None:
    (first,) = visit()
    assert seen(first) == told(PANDA)
    assert first["counts"] == "43 combinations; 20 parameters known alone"
    assert first["picture"] == "drawn"
    assert len(first["classes"]) == 70


@pytest.mark.slow
def test_gravity_and_a_floating_base(visit: Visit) -> None:
    _, still, floating, tilted = visit(
        ("choose", "#gravity", "none"),
        ("click", "#floating"),
        ("choose", "#gravity", "0,-9.81,0"),
    )
    assert seen(still) == told(PANDA, "--gravity", "none")
    assert "Base parameters: 43 → 39." in still["differences"]
    assert any(line.startswith("lost: ") for line in still["differences"])
    assert seen(floating) == told(PANDA, "--gravity", "none", "--floating")
    assert seen(tilted) == told(PANDA, "--gravity", "0,-9.81,0", "--floating")


CLICKS: dict[str, list[Step]] = {
    "a joint is held": [("click", "#joints [data-name=j3]")],
    "a length is zero": [("click", "#lengths [data-name=a4]")],
    "two lengths are equal": [
        ("silently", "choose", "#first", "d3"),
        ("silently", "choose", "#second", "d5"),
        ("click", "#equate"),
    ],
    "a payload": [("choose", "#payload", "j7")],
    "the wrench under the base": [("click", "#sense-base"), ("click", "#sense-file")],
    "joints and wrist": [("click", "#sense-joints"), ("choose", "#wrist", "j7")],
    "a wrist beside the file's": [("choose", "#wrist", "j7")],
    "friction and rotors": [
        ("click", "#effects [data-name=viscous]"),
        ("click", "#effects [data-name=rotor_inertia]"),
    ],
}


def edited(case: str, folder: Path) -> Answer:
    """Output of ``echelon derive`` for a robot with a change written into its file."""
    robot = yaml.safe_load(PANDA.read_text())
    EDITS[case][1](robot)
    file = folder / "panda.yaml"
    file.write_text(yaml.safe_dump(robot))
    return derived(file)


@pytest.mark.slow
@pytest.mark.parametrize("case", CLICKS)
def test_clicks(case: str, visit: Visit, tmp_path: Path) -> None:
    first, *_, changed, undone = visit(*CLICKS[case], ("click", "#reset"))
    assert seen(changed) == edited(case, tmp_path)
    assert seen(undone) == seen(first)


@pytest.mark.slow
def test_a_second_experiment_wins(visit: Visit) -> None:
    *_, kept, tilted, back = visit(
        ("click", "#keep"),
        ("choose", "#gravity", "0,-9.81,0"),
        ("click", "#beside button"),
    )
    assert "43" in kept["headline"]
    assert "Base parameters: 43 → 45." in tilted["differences"]
    assert seen(back) == told(PANDA, "--gravity", "0,-9.81,0")


@pytest.mark.slow
def test_a_parameter_is_preferred(visit: Visit) -> None:
    *_, last = visit(("click", "[data-parameter=M7]"))
    assert seen(last) == told(PANDA, "--prefer", "M7")
    assert "M7" in last["hash"]


@pytest.mark.slow
def test_a_link_brings_the_answer_back(visit: Visit) -> None:
    *_, last = visit(
        ("click", "#joints [data-name=j2]"), ("choose", "#gravity", "none")
    )
    (again,) = visit(address=last["hash"])
    assert seen(again) == seen(last)


@pytest.mark.slow
def test_a_robot_of_the_zoo_leads_to_its_page(visit: Visit) -> None:
    first, floating, other = visit(
        ("click", "#floating"),
        ("choose", "#choice", "panda.yaml"),
        address="#robot=arm.urdf",
    )
    assert (first["page"], floating["page"], other["page"]) == (
        "../zoo/arm/index.html",
        "../zoo/arm-floating/index.html",
        "",
    )
    assert seen(first) == told(ARM)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "options"),
    [("index.html", []), ("arm-floating/index.html", ["--floating"])],
)
def test_the_zoo_leads_to_the_explorer_and_back(
    start: str, options: list[str], explorer: Explorer
) -> None:
    explorer.browser.open(f"http://127.0.0.1:{explorer.port}/zoo/{start}")
    explorer.browser.follow("a.explore")
    assert seen(explorer.answered()) == told(ARM, *options)
    explorer.browser.follow("#page a")
    title = "floating" if options else "fixed"
    assert explorer.browser.evaluate("document.title") == f"so101, {title} base"
    explorer.check()


WRITE: Step = ("silently", "click", "#write summary")


@pytest.mark.slow
def test_a_description_is_written(visit: Visit, tmp_path: Path) -> None:
    text = "echelon: 1\nname: own\nmodified_dh:\n- {joint: revolute}\n- {joint: revolute, a: 1/2}\n"
    (tmp_path / "robot.yaml").write_text(text)
    *_, offered, closed, again, accepted, _, last = visit(
        WRITE,
        ("silently", "type", "#editor", "echelon: 1\nmod"),
        ("silently", "press", "Escape"),
        ("silently", "press", " ", "ctrl"),
        ("silently", "press", "Enter"),
        ("silently", "type", "#editor", text),
        ("press", "Enter", "ctrl"),
    )
    assert (offered["words"], closed["words"], again["words"]) == (
        ["modified_dh"],
        [],
        ["modified_dh"],
    )
    assert accepted["editor"] == "echelon: 1\nmodified_dh: "
    assert seen(last) == derived(tmp_path / "robot.yaml")
    (linked,) = visit(address=last["hash"])
    assert seen(linked) == seen(last)


@pytest.mark.slow
def test_a_bad_file_gives_the_line_of_the_command(visit: Visit, tmp_path: Path) -> None:
    text = "echelon: 1\nname: x\nmodified_dh:\n- {joint: revolut}\n"
    (tmp_path / "robot.yaml").write_text(text)
    *_, last = visit(
        WRITE, ("silently", "type", "#editor", text), ("click", "#robot [type=submit]")
    )
    assert last["error"] == run("derive", "robot.yaml", cwd=tmp_path).stderr.rstrip(
        "\n"
    )


_IN_FRONT = """(() => {
  const { left, right, top, bottom } = document.querySelector("#error").getBoundingClientRect();
  return document.elementFromPoint((left + right) / 2, (top + bottom) / 2)?.id;
})()"""


@pytest.mark.slow
@pytest.mark.parametrize("screen", [LIGHT, PHONE])
def test_an_error_is_seen_where_the_visitor_is(
    screen: Any, visit: Visit, explorer: Explorer
) -> None:
    """Also far down the page; the choices stay, so that the visitor can take the last one back."""
    explorer.browser.size(*screen[:2])
    try:
        *_, wrong, right = visit(
            ("click", "#keep"),
            ("choose", "#gravity", "none"),
            ("choose", "#gravity", "file"),
        )
        assert "choose a direction of gravity" in wrong["error"]
        assert right["error"] == ""
        explorer.act("choose", "#gravity", "none")
        explorer.browser.evaluate("document.querySelector('#keep').scrollIntoView()")
        assert explorer.browser.evaluate(_IN_FRONT) == "error"
        explorer.act("click", "#joints [data-name=j3]")
    finally:
        explorer.browser.size(1400, 900)


@pytest.mark.slow
def test_files_are_dropped(visit: Visit, tmp_path: Path) -> None:
    hostile = tmp_path / "hostile.urdf"
    hostile.write_text(HOSTILE)
    dropped, bad = visit(("drop", "#drop", ARM), ("drop", "#table", hostile))[1:]
    assert seen(dropped) == told(ARM)
    assert bad["strange"] == 0
    assert seen(bad) == derived(hostile)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["json", "latex", "c"])
def test_downloads_are_files(
    kind: str, visit: Visit, explorer: Explorer, tmp_path: Path
) -> None:
    visit(("click", "#joints [data-name=j3]"))
    request = {
        "name": PANDA.name,
        "text": PANDA.read_text(),
        "changes": {"locked": ["j3"]},
        "file": kind,
    }
    files = json.loads(answers().answer(json.dumps(request)))["files"]
    act = partial(explorer.browser.click, f"[data-file={kind}]")
    assert explorer.browser.downloads(tmp_path, len(files), act) == files
    explorer.check()


@pytest.mark.slow
def test_a_hostile_file_is_only_text(visit: Visit) -> None:
    bad = "<img src=x onerror=alert(1)><script>alert(1)</script>"
    robot = {
        "echelon": 1,
        "name": bad,
        "symbols": {"l": 1},
        "modified_dh": [{"joint": "revolute"}] * 2,
    }
    robot["modified_dh"] = [
        {"joint": "revolute"},
        {"joint": "revolute", "a": "l", "name": bad, "label": "</td>$\\href{x}{y}"},
    ]
    *_, last = visit(
        WRITE,
        ("silently", "type", "#editor", json.dumps(robot)),
        ("click", "#robot [type=submit]"),
    )
    assert last["strange"] == 0
    assert bad in last["headline"] or bad in last["error"]


@pytest.mark.slow
def test_unknown_robots_in_links(visit: Visit) -> None:
    (first,) = visit(address="#robot=..%2F..%2Fsecret.yaml")
    assert first["error"] == "echelon: there is no robot '../../secret.yaml' here"


@pytest.mark.slow
@pytest.mark.parametrize("screen", [LIGHT, DARK, PHONE])
def test_the_page_can_be_read(screen: Any, visit: Visit, explorer: Explorer) -> None:
    """Contrast, labels and width, with an answer, with changes made, and with an error."""
    width, height, dark = screen
    explorer.browser.size(width, height)
    explorer.browser.colours(dark=dark)
    try:
        visit(
            WRITE, ("click", "#joints [data-name=j3]"), ("click", "[data-parameter=M7]")
        )
        assert complaints({"answer": audit(explorer.browser)}) == {}
        visit(address="#robot=none")
        assert complaints({"error": audit(explorer.browser)}) == {}
    finally:
        explorer.browser.size(1400, 900)
        explorer.browser.colours(dark=False)


@pytest.mark.slow
def test_everything_is_reached_by_keyboard(visit: Visit, explorer: Explorer) -> None:
    visit(address="#robot=arm.urdf")
    controls = """[...document.querySelectorAll("a[href], button, input, select, textarea, summary, [tabindex='0']")]
      .filter((e) => e.checkVisibility({ visibilityProperty: true }) && e.tabIndex >= 0)"""
    count = explorer.browser.evaluate(f"{controls}.length")
    order = f"{controls}.indexOf(document.activeElement)"
    found = []
    for _ in range(count):
        explorer.browser.press("Tab")
        found.append(explorer.browser.evaluate(order))
    assert found == list(range(count))
    explorer.browser.evaluate("document.querySelector('#canvas').focus()")
    before = explorer.browser.picture()
    explorer.browser.press("ArrowRight")
    assert explorer.browser.picture() != before
    explorer.browser.evaluate("document.querySelector('#joints button').focus()")
    locked = explorer.act("press", " ")
    first = json.loads(
        answers().answer(
            json.dumps({"name": ARM.name, "text": ARM.read_text(), "changes": {}})
        )
    )
    assert f"locked={first['joints'][0]}" in locked["hash"]
    assert (
        explorer.browser.evaluate("document.activeElement.dataset.name")
        == first["joints"][0]
    )
    explorer.check()


_LOADED = """
import json, sys
from pathlib import Path
from explorer import answer
for file, kind in zip(sys.argv[1:], ("", "json", "latex", "c")):
    asked = {"name": file, "text": Path(file).read_text(), "changes": {}, "file": kind}
    assert "error" not in json.loads(answer(json.dumps(asked)))
print(*(module.__file__ for module in list(sys.modules.values()) if module.__name__.startswith("echelon")), sep="\\n")
"""


def test_what_answers_is_packed_for_browsers() -> None:
    """Modules that no import names would be missing there."""
    explorer = ROOT / "site" / "explorer"
    files = [
        str(EXAMPLES / name)
        for name in (
            "loops/parallelogram.yaml",
            "so101.urdf",
            "coupled_arm.yaml",
            "scara.yaml",
        )
    ]
    paths = os.pathsep.join(str(path) for path in (ROOT / "src", explorer))
    done = subprocess.run(
        [sys.executable, "-c", _LOADED, *files],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    )
    packed = module("browser_python", "browser_python.py").reachable(
        explorer / "explorer.py", ROOT / "src"
    )
    assert set(map(Path, done.stdout.split())) <= packed


def test_libraries_keep_what_others_import() -> None:
    """Two libraries of one function each, written by hand; the first exports another name that no one wants."""
    packing = module("browser_python", "browser_python.py")
    head, function = b"\0asm\x01\0\0\0", b"\x01\x04\x01\x60\0\0\x03\x02\x01\0"
    exports = b"\x07\x0e\x02\x04used\0\0\x03odd\0\0"
    body = b"\x0a\x04\x01\x02\0\x0b"
    importing = head + b"\x01\x04\x01\x60\0\0" + b"\x02\x0c\x01\x03env\x04used\0\0"
    wanted = {name for name, _ in packing._entries(importing, packing.IMPORTS)}
    assert wanted == {b"used"}
    kept = packing._with_exports(head + function + exports + body, wanted)
    assert kept == head + function + b"\x07\x08\x01\x04used\0\0" + body


@pytest.mark.slow
def test_echelon_in_pyodide(tmp_path: Path) -> None:
    """The page's own worker answers, where NumPy for Pyodide can be had or built; under CI it must be."""
    builder = module("build_explorer", "build_explorer.py")
    wheels = os.environ.get("ECHELON_WHEELS")
    missing = builder.build(
        tmp_path / "site" / "explorer",
        [EXAMPLES],
        ROOT / "build" / "cache",
        wheels and Path(wheels),
    )
    if missing:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(
            f"{', '.join(missing)} for Pyodide cannot be had"
        )
    steps: list[Step] = [
        step for clicks in CLICKS.values() for step in (*clicks, ("click", "#reset"))
    ]
    with serving(tmp_path / "site") as port, DevTools(tmp_path / "profile") as browser:
        found = Explorer(browser, port, limit=400).visit(*steps)
        (tmp_path / "code").mkdir()
        files = browser.downloads(
            tmp_path / "code", 2, partial(browser.click, "[data-file=c]")
        )
    request = {
        "name": PANDA.name,
        "text": PANDA.read_text(),
        "changes": {},
        "file": "c",
    }
    assert files == json.loads(answers().answer(json.dumps(request)))["files"]
    assert seen(found[0]) == told(PANDA)
    place = 0
    for case, clicks in CLICKS.items():
        place += len(clicks)
        assert seen(found[place]) == edited(case, tmp_path)
        place += 1
