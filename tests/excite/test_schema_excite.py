"""The section ``excitation`` of descriptions: what it may hold, what it becomes, and what is said about mistakes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

import echelon as ec
from echelon.formats.description.document import check_document, read_text
from echelon.formats.schema.robot_schema import json_schema
from echelon.formats.schema.schema_excite import (
    NO_LIMIT,
    BoxEntry,
    CollisionsEntry,
    ExcitationEntry,
    FrameEntry,
    HalfSpaceEntry,
    LimitsEntry,
)
from echelon.formats.schema.schema_types import Model
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.shared import plain_data
from support.descriptions import read_description

ARM = """
echelon: 1
name: arm
modified_dh:
  - {joint: revolute}
  - {joint: revolute, a: 0.5}
"""
FULL = """
excitation:
  duration: 10
  rate: 200
  family: bspline
  harmonics: 7
  segments: 12
  criterion: condition
  noise: {all: 1, j2: 1/10}
  move: [j1]
  hold: {j2: -pi/2}
  centre: {j1: 0.3}
  limits:
    position: {j1: [-pi, 3.1], j2: [none, 2], all: none}
    velocity: 2*pi
    acceleration: {all: 10, j1: none}
    jerk: none
    effort: {j1: 87}
    scale: 0.8
  effort_margin: 0.2
  frames:
    - {body: j2, point: [0, 0, 0.1], radius: 0.05, box: {x: [-0.5, none], z: [0.05, 1.2]}}
    - {body: j2, above: {normal: [0, 3, 4], offset: -0.2}}
  collisions:
    self: false
    clearance: 0.01
    shapes: [{body: j1, capsule: 0.1, from: [0, 0, 0], to: [0, 0, pi/4]}]
    obstacles: [{name: ball, sphere: 0.1}]
    exclude: [[j1, table]]
    ignore_touching: true
  starts: 8
  seed: 0
  iterations: 60
"""
MODELS = (
    ExcitationEntry,
    LimitsEntry,
    FrameEntry,
    BoxEntry,
    HalfSpaceEntry,
    CollisionsEntry,
)


def read(section: str) -> ExcitationEntry:
    return check_document(read_text(ARM + section, "arm.yaml")).excitation


def test_every_key_becomes_numbers_in_si_units() -> None:
    entry = read(FULL)
    assert (
        entry.duration,
        entry.rate,
        entry.family,
        entry.harmonics,
        entry.segments,
    ) == (10, 200, "bspline", 7, 12)
    assert (entry.criterion, entry.noise, entry.move) == (
        "condition",
        {"all": 1, "j2": 0.1},
        ("j1",),
    )
    assert (entry.hold, entry.centre, entry.effort_margin) == (
        {"j2": -math.pi / 2},
        {"j1": 0.3},
        0.2,
    )
    assert (entry.starts, entry.seed, entry.iterations) == (8, 0, 60)
    limits, free = entry.limits, math.inf
    assert limits.position == {
        "j1": (-math.pi, 3.1),
        "j2": (-free, 2),
        "all": (-free, free),
    }
    assert (limits.velocity, limits.acceleration) == (
        {"all": math.tau},
        {"all": 10, "j1": free},
    )
    assert (limits.jerk, limits.effort, limits.scale) == (
        {"all": free},
        {"j1": 87},
        0.8,
    )
    inside, over = entry.frames
    assert (inside.body, inside.point, inside.radius, inside.above) == (
        "j2",
        (0, 0, 0.1),
        0.05,
        None,
    )
    assert inside.box is not None
    assert (inside.box.x, inside.box.y, inside.box.z) == (
        (-0.5, free),
        None,
        (0.05, 1.2),
    )
    assert over.above is not None
    assert over.above.normal == pytest.approx((0, 0.6, 0.8), abs=1e-15)
    assert (over.above.offset, over.radius, over.point) == (-0.2, 0, (0, 0, 0))
    pairs = entry.collisions
    assert (pairs.self, pairs.clearance, pairs.ignore_touching, pairs.exclude) == (
        False,
        0.01,
        True,
        (("j1", "table"),),
    )
    assert pairs.shapes == (
        {"body": "j1", "capsule": 0.1, "from": [0, 0, 0], "to": [0, 0, math.pi / 4]},
    )
    assert pairs.obstacles == ({"name": "ball", "sphere": 0.1},)


@pytest.mark.parametrize(
    "section", ["", "excitation: {limits: {}, collisions: {}, iterations: 500}"]
)
def test_what_is_absent_has_the_defaults(section: str) -> None:
    entry = read(section)
    assert (
        entry.duration,
        entry.rate,
        entry.family,
        entry.harmonics,
        entry.segments,
    ) == (
        None,
        100,
        "fourier",
        None,
        8,
    )
    assert (entry.criterion, entry.noise, entry.move) == ("condition", {"all": 1}, None)
    assert (entry.hold, entry.centre, entry.effort_margin, entry.frames) == (
        {},
        {},
        0.1,
        (),
    )
    assert (entry.starts, entry.seed, entry.iterations, entry.budget) == (
        4,
        2015,
        500,
        40,
    )
    limits, pairs = entry.limits, entry.collisions
    assert (limits.position, limits.velocity, limits.acceleration) == ({}, {}, {})
    assert (limits.jerk, limits.effort, limits.scale) == ({}, {}, 1)
    assert (pairs.self, pairs.clearance, pairs.ignore_touching) == (True, 0.02, False)
    assert (pairs.shapes, pairs.obstacles, pairs.exclude) == ((), (), ())


@pytest.mark.parametrize("unset", [True, False])
def test_what_is_written_as_json_is_read_again(unset: bool) -> None:
    entry = read(FULL)
    data = plain_data(entry.model_dump(exclude_unset=unset), NO_LIMIT)
    text = json.dumps(data, allow_nan=False)
    assert ExcitationEntry.model_validate(json.loads(text)) == entry
    assert ExcitationEntry.model_validate(ExcitationEntry().model_dump()) == read("")


def test_the_published_schema_accepts_what_is_read() -> None:
    jsonschema.Draft202012Validator(json_schema()).validate(yaml.safe_load(ARM + FULL))


@pytest.mark.parametrize(
    "section",
    [
        {"limits": {"velocity": [1, 2]}},
        {"frames": [{"point": [0, 0, 0]}]},
        {"noise": {"j1": []}},
    ],
)
def test_the_published_schema_refuses_other_shapes(section: dict[str, Any]) -> None:
    document = {**yaml.safe_load(ARM), "excitation": section}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(json_schema()).validate(document)
    with pytest.raises(ec.InputError):
        check_document(read_text(json.dumps(document), "arm.json"))


@pytest.mark.parametrize("model", MODELS)
def test_fields_are_described_by_examples_that_hold(model: type[Model]) -> None:
    needed = {
        FrameEntry: {"body": "hand", "above": {"normal": [0, 0, 1]}},
        HalfSpaceEntry: {"normal": [0, 0, 1]},
        BoxEntry: {"z": [0, 1]},
    }
    for name, field in model.model_fields.items():
        assert field.description, name
        for example in field.examples or ():
            data = {**needed.get(model, {}), name: example}  # type: ignore[call-overload]
            model.model_validate(
                {
                    key: value
                    for key, value in data.items()
                    if key != "above" or name != "box"
                }
            )


def test_numbers_of_python_are_accepted() -> None:
    entry = ExcitationEntry.model_validate(
        {"rate": 1e3, "starts": 2, "limits": {"velocity": {"j1": 2}}}
    )
    assert (entry.rate, entry.starts, entry.limits.velocity) == (1000, 2, {"j1": 2})


@pytest.mark.parametrize(
    ("section", "said"),
    [
        (
            "{durations: 3}",
            "excitation.durations: unknown key; did you mean 'duration'?",
        ),
        ("{duration: 0}", "excitation.duration: needs a number greater than 0"),
        ("{rate: inf}", "excitation.rate: 'inf' is not a finite number"),
        (
            "{rate: l1}",
            "excitation.rate: needs a number or an expression of numbers and pi, found 'l1'",
        ),
        ("{rate: 10/0}", "only division by a non-zero number"),
        ("{rate: 1e999}", "'1e999' is beyond the range of double precision"),
        (
            "{rate: true}",
            "excitation.rate: needs a number or an expression of numbers and pi, found 'true'",
        ),
        (
            "{rate: }",
            "excitation.rate: needs a number such as 0.5 or 2*pi, found nothing",
        ),
        (
            "{family: fourrier}",
            "excitation.family: 'fourrier' is not valid; did you mean 'fourier'?",
        ),
        ("{criterion: d}", "excitation.criterion: 'd' is not valid"),
        ("{harmonics: 2.5}", "excitation.harmonics: needs a whole number, found '2.5'"),
        (
            "{segments: 0}",
            "excitation.segments: needs a number greater than or equal to 1",
        ),
        ("{starts: inf}", "excitation.starts: needs a whole number, found 'inf'"),
        ("{seed: -1}", "excitation.seed: needs a number greater than or equal to 0"),
        (
            "{iterations: 0}",
            "excitation.iterations: needs a number greater than or equal to 1",
        ),
        ("{noise: {j1: 0}}", "excitation.noise.j1: needs a number greater than 0"),
        ("{move: j1}", "excitation.move: needs a list, found 'j1'"),
        (
            "{hold: {j1: x}}",
            "excitation.hold.j1: needs a number or an expression of numbers and pi, found 'x'",
        ),
        ("{hold: 0}", "excitation.hold: needs a mapping 'name: value', found '0'"),
        (
            "{move: [j1], hold: {j1: 0}}",
            "'j1' moves and is held: name it under move or under hold",
        ),
        (
            "{hold: {j1: 0}, centre: {j1: 0}}",
            "'j1' is held, so its motion has no centre",
        ),
        (
            "{limits: {velocity: inf}}",
            "velocity: 'inf' is not a finite number: write none for no limit",
        ),
        (
            "{limits: {effort: {j1: .inf}}}",
            "effort.j1: '.inf' is not a finite number: write none for",
        ),
        (
            "{limits: {position: {j1: [-inf, 1]}}}",
            "position.j1: '-inf' is not a finite number: write none for",
        ),
        (
            "{limits: {jerk: {j1: -3}}}",
            "excitation.limits.jerk.j1: needs a number greater than 0",
        ),
        (
            "{limits: {acceleration: unlimited}}",
            "limits.acceleration: needs a number or an expression",
        ),
        (
            "{limits: {position: {j1: [1, -1]}}}",
            "limits.position.j1: the range is empty: 1 is larger than -1",
        ),
        (
            "{limits: {position: {j1: 2}}}",
            "limits.position.j1: needs a range such as [-1.5, pi/2], found '2'",
        ),
        (
            "{limits: {position: {j1: [1]}}}",
            "limits.position.j1: needs a range such as [-1.5, pi/2], found 1 entries",
        ),
        (
            "{limits: {velocty: 1}}",
            "excitation.limits.velocty: unknown key; did you mean 'velocity'?",
        ),
        (
            "{limits: {scale: 0}}",
            "excitation.limits.scale: needs a number greater than 0",
        ),
        (
            "{limits: {scale: 1.1}}",
            "excitation.limits.scale: needs a number less than or equal to 1",
        ),
        ("{effort_margin: 1}", "excitation.effort_margin: needs a number less than 1"),
        ("{frames: {body: j2}}", "excitation.frames: needs a list, found a mapping"),
        ("{frames: [{body: j2}]}", "excitation.frames[0]: give box or above"),
        (
            "{frames: [{body: j2, box: {x: [0, 1]}, above: {normal: [0, 0, 1]}}]}",
            "give box or above, not both",
        ),
        (
            "{frames: [{body: j2, box: {}}]}",
            "excitation.frames[0].box: the box limits nothing: give x, y or z",
        ),
        (
            "{frames: [{body: j2, above: {normal: [0, 0, 0]}}]}",
            "above.normal: the normal is zero",
        ),
        (
            "{frames: [{body: j2, above: {offset: 1}}]}",
            "above: the key 'normal' is missing",
        ),
        (
            "{frames: [{body: j2, point: [0, 1], box: {x: [0, 1]}}]}",
            "[0].point: needs three numbers such as",
        ),
        (
            "{frames: [{body: j2, radius: -1, box: {x: [0, 1]}}]}",
            "[0].radius: needs a number greater than or equal",
        ),
        (
            "{collisions: {self: maybe}}",
            "excitation.collisions.self: needs true or false, found 'maybe'",
        ),
        (
            "{collisions: {clearance: -1}}",
            "collisions.clearance: needs a number greater than or equal to 0",
        ),
        (
            "{collisions: {shapes: [ball]}}",
            "collisions.shapes[0]: needs a mapping such as {body: link3, sphere: 0.06}, found 'ball'",
        ),
        (
            "{collisions: {shapes: [{sphere: {radius: 0.1}}]}}",
            "collisions.shapes[0]: needs a number such as 0.5",
        ),
        (
            "{collisions: {exclude: [[a]]}}",
            "exclude[0]: needs a pair of names such as [link1, link3], found 1 entries",
        ),
        (
            "{collisions: {exclude: [a, b]}}",
            "exclude[0]: needs a pair of names such as [link1, link3], found 'a'",
        ),
    ],
)
def test_mistakes_are_named_with_their_place(section: str, said: str) -> None:
    with pytest.raises(ec.InputError) as caught:
        read(f"excitation: {section}")
    assert said in str(caught.value)
    assert "(line 7)" in str(caught.value)
    assert str(caught.value).startswith("arm.yaml: excitation")


def test_the_robot_is_the_same_with_the_section_and_is_written_without(
    tmp_path: Path,
) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(ARM + FULL, encoding="utf-8")
    mechanism = ec.load(file)
    plain = read_description(ARM, "arm.yaml", ReadingOptions())
    assert mechanism == plain
    assert write_description(mechanism) == write_description(plain)
    assert ec.load_setup(file).mechanism == plain
