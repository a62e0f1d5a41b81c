"""Files that couple joints: the count of the other reading beside that of the chosen one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import echelon as ec
from echelon.base.display import to_text
from echelon.base.reading_report import MimicRanks
from echelon.cli.commands import app
from support.mjcf_models import INERTIA, model
from support.robot_files import robot_file

URDF = """<robot name="gripper"><link name="palm"/><link name="left"/><link name="right"/>
<joint name="l" type="prismatic"><parent link="palm"/><child link="left"/><axis xyz="0 1 0"/></joint>
<joint name="r" type="revolute"><parent link="palm"/><child link="right"/><axis xyz="0 1 0"/>MIMIC</joint></robot>"""
MIMIC = '<mimic joint="l" multiplier="-3"/>'
GRIPPER = URDF.replace("MIMIC", MIMIC)
SETUP = "echelon: 1\nrobot: {file: gripper.urdf}\neffects: [{type: viscous, at: l}]\n"
TENDON = model(
    f'<body name="a"><joint name="a" axis="0 1 0"/>{INERTIA}</body><body name="b"><joint name="b"/>{INERTIA}</body>',
    tail='<tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="-2"/></fixed></tendon>'
    '<equality><tendon tendon1="t"/></equality>',
)


def ranks(folder: Path, name: str, text: str) -> list[MimicRanks | None]:
    """The counts that stand in the reports of both readings, which are those of the readings themselves."""
    (folder / "gripper.urdf").write_text(GRIPPER)
    (folder / name).write_text(text)
    bases = [
        ec.base_parameters(ec.load(folder / name, independent_mimics=mimics))
        for mimics in (False, True)
    ]
    for base in bases:
        if base.reading.mimics is not None:
            assert base.reading.mimics == MimicRanks(*(other.rank for other in bases))
            assert f"mimic joints: {base.reading.mimics}" in to_text(base)
    return [base.reading.mimics for base in bases]


@pytest.mark.parametrize(
    ("name", "text"),
    [("gripper.urdf", GRIPPER), ("a.xml", TENDON), ("setup.yaml", SETUP)],
)
def test_both_counts_stand_in_both_reports(
    tmp_path: Path, name: str, text: str
) -> None:
    found = ranks(tmp_path, name, text)
    assert found[0] == found[1] is not None


def test_files_without_couplings_have_one_count(tmp_path: Path) -> None:
    assert ranks(tmp_path, "free.urdf", URDF.replace("MIMIC", "")) == [None, None]


def test_couplings_that_make_no_sense_are_left_alone_on_request(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(URDF.replace("MIMIC", '<mimic joint="ghost"/>'))
    assert (
        ec.base_parameters(
            ec.load(tmp_path / "r.urdf", independent_mimics=True)
        ).reading.mimics
        is None
    )


def test_saved_sets_keep_both_counts(tmp_path: Path) -> None:
    base = ec.base_parameters(ec.load(robot_file("panda")))
    assert base.reading.mimics == MimicRanks(48, 51)
    ec.save_base(base, tmp_path / "base.json")
    assert json.loads((tmp_path / "base.json").read_text())["reading"]["mimics"] == {
        "coupled": 48,
        "independent": 51,
    }
    assert ec.load_base(tmp_path / "base.json").reading.mimics == base.reading.mimics


def test_the_rank_alone_has_both_counts(tmp_path: Path) -> None:
    both = ranks(tmp_path, "gripper.urdf", GRIPPER)[0]
    for arguments, wanted in (
        ([], f"mimic joints: {both}"),
        (["--json"], '"mimics": {'),
    ):
        shown = CliRunner().invoke(
            app, ["derive", str(tmp_path / "gripper.urdf"), "--rank-only", *arguments]
        )
        assert wanted in shown.output
