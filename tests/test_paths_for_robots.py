"""Every public function that takes a robot, a linear model or a set of base parameters takes its path as well."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path
from typing import Any

import pytest

import echelon as ec
from echelon.shared.errors import InputError
from support.paths import EXAMPLES

MODELS = re.compile(r"\b(Mechanism|LinearModel|BaseModel|Model|Setup)\b")
RESULTS_ARE_THEIR_TOPIC = {"save_base"}  # writes a set that was derived
ROBOT = EXAMPLES / "double_pendulum.yaml"
WITH_MODELS = {
    name: [
        p.name
        for p in inspect.signature(getattr(ec, name)).parameters.values()
        if MODELS.search(str(p.annotation))
    ]
    for name in ec.__all__
    if inspect.isfunction(getattr(ec, name)) and name not in RESULTS_ARE_THEIR_TOPIC
}


@pytest.mark.parametrize(
    ("name", "parameters"), [(n, p) for n, p in WITH_MODELS.items() if p]
)
def test_what_takes_a_model_says_that_it_takes_a_path(
    name: str, parameters: list[str]
) -> None:
    function = getattr(ec, name)
    for parameter in parameters:
        annotation = str(inspect.signature(function).parameters[parameter].annotation)
        assert "Readable" in annotation or "os.PathLike" in annotation, parameter
    assert "path" in (inspect.getdoc(function) or "").split("Returns")[0]


CALLS: dict[str, Any] = {
    "base_parameters": lambda robot: ec.base_parameters(robot),
    "base_structure": lambda robot: ec.base_structure(robot),
    "compare_numeric": lambda robot: ec.compare_numeric(robot),
    "energy_regressor": lambda robot: ec.energy_regressor(robot),
    "power_regressor": lambda robot: ec.power_regressor(robot),
    "special_geometry": lambda robot: ec.special_geometry(robot),
    "sensor_report": lambda robot: ec.sensor_report(robot),
    "match": lambda robot: ec.match(robot, robot),
    "same_row_space": lambda robot: ec.same_row_space(robot, robot),
    "audit": lambda robot: ec.audit(robot, ["ZZ2"]),
    "generate": lambda robot: sorted(ec.generate(robot)),
    "joint_side": lambda robot: ec.joint_side(robot, [[0.1, 0.2]]).tolist(),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_path_gives_what_its_robot_gives(name: str, tmp_path: Path) -> None:
    loaded = repr(CALLS[name](ec.load(ROBOT)))
    assert repr(CALLS[name](ROBOT)) == loaded
    assert repr(CALLS[name](str(ROBOT))) == loaded
    ec.save_base(ec.base_parameters(ROBOT), tmp_path / "set.json")
    assert repr(CALLS[name](tmp_path / "set.json")) == loaded


def test_a_path_of_a_loop_and_of_a_linear_model() -> None:
    assert isinstance(
        ec.base_parameters(EXAMPLES / "linear/arrhenius.yaml"), ec.LinearBase
    )
    assert isinstance(ec.load_model(EXAMPLES / "linear/arrhenius.yaml"), ec.LinearModel)


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("wrong", [3, None, [1, 2], b"arm.urdf", {"a": 1}])
def test_what_is_neither_is_refused_with_what_would_be_valid(
    name: str, wrong: object
) -> None:
    with pytest.raises(InputError, match="path"):
        CALLS[name](wrong)


@pytest.mark.parametrize(
    "name", ["base_structure", "generate", "audit", "sensor_report"]
)
def test_a_linear_model_is_no_robot(name: str) -> None:
    with pytest.raises(InputError, match=r"arrhenius\.yaml: a robot is needed"):
        CALLS[name](EXAMPLES / "linear/arrhenius.yaml")


def test_a_saved_set_of_a_linear_model(tmp_path: Path) -> None:
    base = ec.base_parameters(EXAMPLES / "linear/arrhenius.yaml")
    ec.save_base(base, tmp_path / "set.json")
    assert repr(ec.load_model(tmp_path / "set.json")) == repr(base)
    assert ec.base_parameters(tmp_path / "set.json").rank == base.rank
    assert ec.same_row_space(base, tmp_path / "set.json")


def test_a_saved_set_is_not_read_with_other_options(tmp_path: Path) -> None:
    ec.save_base(ec.base_parameters(ROBOT), tmp_path / "set.json")
    with pytest.raises(InputError, match="saved set"):
        ec.load_model(tmp_path / "set.json", floating=True)


# -- texts -------------------------------------------------------------------------------------------------------------


def test_json_in_one_line_is_text() -> None:
    body = {"name": "a", "joint": {"type": "revolute", "axis": "z"}}
    text = json.dumps({"echelon": 1, "name": "one", "bodies": [body]})
    assert ec.load(text).name == "one"
    assert ec.load(f"  {text}").name == "one"
    assert ec.base_structure(text).rank == 1


def test_a_long_text_is_not_printed_whole() -> None:
    with pytest.raises(InputError) as caught:
        ec.load("echelon: 1, " * 400)
    assert len(str(caught.value)) < 400
