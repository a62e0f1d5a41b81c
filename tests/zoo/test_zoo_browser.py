"""The zoo in a browser: its numbers are those of ``echelon derive``, and it can be read, searched and reached."""

from __future__ import annotations

from pathlib import Path

import pytest

import echelon as ec
from robot_zoo.build import write_index
from robot_zoo.exhibit import Found, ZooTask, build_exhibit
from support.hostile_robot import HOSTILE, NAME
from support.paths import EXAMPLES
from support.site_audit import DARK, LIGHT, PHONE, audited, complaints

pytestmark = pytest.mark.slow
ROBOTS = {"arm": EXAMPLES / "so101.urdf", "puma": EXAMPLES / "puma560.yaml"}
NUMBERS = """async (page) => ({
  rank: page.querySelector(".verdict b")?.textContent, forms: page.querySelectorAll(".forms tr").length,
  cells: page.querySelectorAll(".classes td[class]").length,
  rows: [...page.querySelectorAll(".robots tbody tr")].map((row) => [...row.cells].map((c) => c.textContent.trim())),
  dots: page.querySelectorAll(".zoo-plot a").length,
})"""
SEARCH = """async (page, rest) => {
  const rows = () => [...page.querySelectorAll(".robots tbody tr")];
  const shown = () => rows().filter((row) => !row.hidden).map((row) => row.dataset.slug);
  const choose = async (id, value) => {
    const control = page.getElementById(id);
    control.value = value;
    control.dispatchEvent(new Event("input", { bubbles: true }));
    await rest(20);
    return shown();
  };
  const found = { words: await choose("search", "puma"), all: await choose("search", "") };
  found.literal = await choose("shows", "literal");
  await choose("shows", "");
  const heads = [...page.querySelectorAll(".robots thead button")];
  heads.find((head) => head.textContent === "standard").click();
  return { ...found, sorted: shown(), focus: heads.every((head) => (head.focus(), page.activeElement === head)) };
}"""


@pytest.fixture(scope="module")
def zoo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("zoo")
    hostile = folder / "hostile.urdf"
    hostile.write_text(HOSTILE, encoding="utf-8")
    files = ROBOTS | {"hostile": hostile}
    rows = [
        build_exhibit(ZooTask(Found(path, path.name, slug), False, folder))
        for slug, path in files.items()
    ]
    assert rows[1] is not None
    rows[1] = {**rows[1], "loops": 1}  # a remark that is no warning
    write_index(
        folder, [row for row in rows if row] + [{**(rows[0] or {}), "failed": NAME}]
    )
    return folder


@pytest.mark.parametrize("screen", [LIGHT, DARK, PHONE])
def test_pages_can_be_read(
    zoo: Path, tmp_path: Path, screen: tuple[int, int, bool]
) -> None:
    pages = ["/index.html", *(f"/{slug}/index.html" for slug in (*ROBOTS, "hostile"))]
    found, asked = audited(zoo, tmp_path / "profile", pages, screen, NUMBERS)
    assert complaints(found) == {}
    assert {path for path in asked if path not in pages} <= {
        "/visit.html",
        "/favicon.ico",
    }
    for slug, file in ROBOTS.items():
        base, page = ec.base_parameters(ec.load(file)), found[f"/{slug}/index.html"]
        assert (page["rank"], page["forms"], page["cells"]) == (
            str(base.rank),
            base.rank,
            len(base.parameters),
        )
        assert [str(len(base.parameters)), str(base.rank)] in [
            row[3:5] for row in found["/index.html"]["rows"]
        ]
    assert found["/index.html"]["dots"] == 3
    for path, page in found.items():
        assert page["first"] == "skip", path
        inside = [(zoo / link.lstrip("/").partition("#")[0]) for link in page["links"]]
        assert [file for file in inside if not file.exists()] == []


def test_the_index_is_searched_and_sorted(zoo: Path, tmp_path: Path) -> None:
    found, _ = audited(zoo, tmp_path / "profile", ["/index.html"], act=SEARCH)
    page = found["/index.html"]
    assert (page["words"], page["all"], page["literal"]) == (
        ["puma"],
        ["arm", "puma", "hostile"],
        ["arm"],
    )
    assert page["sorted"] == ["hostile", "arm", "puma"]
    assert page["focus"]
