"""Commands replace what they wrote themselves, and nothing that a user made."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from echelon.cli.destination import MANIFEST
from support.command_line import run
from support.writing_commands import COMMANDS, OUTPUTS, contents, workplace


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(workplace(tmp_path / "work"))
    return Path.cwd()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_may_run_twice_but_edited_files_stay(folder: Path, name: str) -> None:
    before = contents(folder)
    for _ in range(2):
        done = run(*COMMANDS[name])
        assert (done.returncode, done.stderr) == (0, "")
        after = contents(folder)
        assert after.keys() - before.keys() == OUTPUTS[name]
        assert {file: after[file] for file in before} == before
    edited = sorted(OUTPUTS[name])[-1]
    with (folder / edited).open("ab") as stream:
        stream.write(b"mine\n")
    refused = run(*COMMANDS[name])
    assert refused.returncode == 2
    assert (
        f"{edited}: the file exists and was not written by Echelon, or was changed since"
        in refused.stderr
    )
    assert "--force" in refused.stderr
    assert contents(folder) == {**after, edited: after[edited] + b"mine\n"}


@pytest.mark.parametrize("name", ["derive", "generate", "predict", "check-trajectory"])
def test_force_replaces(folder: Path, name: str) -> None:
    for file in OUTPUTS[name]:
        (folder / file).write_text("somebody's")
    assert run(*COMMANDS[name]).returncode == 2
    assert {(folder / file).read_text() for file in OUTPUTS[name]} == {"somebody's"}
    assert run(*COMMANDS[name], "--force").returncode == 0
    assert "somebody's" not in {(folder / file).read_text() for file in OUTPUTS[name]}
    assert run(*COMMANDS[name]).returncode == 0  # now they are the command's own


@pytest.mark.parametrize("name", sorted(OUTPUTS["identify"]))
def test_a_set_is_refused_for_one_file_of_a_user(folder: Path, name: str) -> None:
    (folder / name).write_text("somebody's")
    before = contents(folder)
    done = run(*COMMANDS["identify"])
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"echelon: {name}: ")
    assert contents(folder) == before


def test_a_set_is_refused_for_a_directory_in_its_way(folder: Path) -> None:
    (folder / "identified.urdf").mkdir()
    before = contents(folder)
    done = run(*COMMANDS["identify"], "--force")
    assert (done.returncode, done.stderr) == (
        2,
        "echelon: identified.urdf: is a directory; name a file\n",
    )
    assert contents(folder) == before


READ = {
    "robot": ("derive", "slide.yaml", "-o", "slide.yaml"),
    "its other name": ("derive", "slide.yaml", "-o", "link.yaml"),
    "log": ("predict", "earlier/model.json", "run.csv", "-o", "run.csv"),
    "claims": ("audit", "slide.yaml", "claims.txt", "-o", "claims.txt"),
    "prior": (
        "check-trajectory",
        "slide.yaml",
        "motion.csv",
        "--prior",
        "slide.yaml",
        "-o",
        "slide.yaml",
    ),
}


@pytest.mark.parametrize("case", READ)
def test_inputs_stay(folder: Path, case: str) -> None:
    (folder / "link.yaml").symlink_to("slide.yaml")
    before = contents(folder)
    assert run(*READ[case]).returncode == 2
    assert run(*READ[case], "--force").returncode == 2
    assert contents(folder) == before


OWN_INPUTS = {
    "claims": (
        ("derive", "slide.yaml", "--json", "-o", "set.json"),
        ("audit", "slide.yaml", "set.json"),
        "set.json",
    ),
    "a file that a file names": (
        ("identify", "slide.yaml", "run.csv", "-o", "."),
        ("derive", "setup.yaml"),
        "identified.urdf",
    ),
}


@pytest.mark.parametrize("case", OWN_INPUTS)
def test_even_an_output_stays_where_it_is_read(folder: Path, case: str) -> None:
    make, use, file = OWN_INPUTS[case]
    (folder / "setup.yaml").write_text("echelon: 1\nrobot: {file: identified.urdf}\n")
    assert run(*make).returncode == 0
    before = contents(folder)
    done = run(*use, "-o", file)
    assert (done.returncode, done.stderr.split("; ")[0]) == (
        2,
        f"echelon: {file}: this command reads the file",
    )
    assert contents(folder) == before
    assert run(*use, "-o", file, "--force").returncode == 2
    assert contents(folder) == before


def test_what_is_empty_or_moved_or_copied(folder: Path) -> None:
    (folder / "set.txt").touch()  # as mktemp makes it: nothing is lost
    assert run(*COMMANDS["derive"]).returncode == 0
    shutil.copy(folder / "set.txt", folder / "copy.txt")  # a copy is its owner's
    assert run("derive", "slide.yaml", "-o", "copy.txt").returncode == 2
    os.replace(folder / "copy.txt", folder / "set.txt")  # the same as before
    assert run(*COMMANDS["derive"]).returncode == 0


def test_options_may_change_between_runs(folder: Path) -> None:
    for form in ("text", "json", "latex", "text"):
        assert (
            run("derive", "slide.yaml", "--format", form, "-o", "set").returncode == 0
        )
    assert (folder / "set").read_text().startswith("slide: 2 base parameters")


@pytest.mark.parametrize("damage", [b"\xff\x00garbage", b"[]", b""])
def test_without_a_manifest_files_are_a_users(folder: Path, damage: bytes) -> None:
    assert run(*COMMANDS["derive"]).returncode == 0
    (folder / MANIFEST).write_bytes(damage)
    assert run(*COMMANDS["derive"]).returncode == 2
    assert run(*COMMANDS["derive"], "--force").returncode == 0
    assert run(*COMMANDS["derive"]).returncode == 0


def test_a_manifest_lists_outputs_of_all_commands(folder: Path) -> None:
    for name in ("derive", "generate"):
        assert run(*COMMANDS[name]).returncode == 0
    listed = json.loads((folder / MANIFEST).read_text())
    assert listed.keys() == OUTPUTS["derive"] | OUTPUTS["generate"]


def test_a_link_leads_to_the_manifest_of_its_file(folder: Path) -> None:
    (folder / "kept").mkdir()
    (folder / "set.txt").symlink_to("kept/set.txt")
    for _ in range(2):
        assert run(*COMMANDS["derive"]).returncode == 0
    assert list(json.loads((folder / "kept" / MANIFEST).read_text())) == ["set.txt"]
    assert not (folder / MANIFEST).exists()
