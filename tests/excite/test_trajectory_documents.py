"""Documents of coefficients that are wrong: the place and the problem are named."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from echelon.errors import InputError
from echelon.excite.files.coefficients import trajectory_from_json, trajectory_to_json
from echelon.excite.files.trajectory_file import read_trajectory, write_trajectory
from echelon.excite.problem.trajectory import uniform_splines
from support.trajectory_motions import NAMES, UNITS, motion, smooth


def spline_document() -> dict[str, Any]:
    return trajectory_to_json(motion(uniform_splines(2.0, 3)))


def changed(document: dict[str, Any], *path: Any, value: Any = None, drop: bool = False) -> dict[str, Any]:
    copied = copy.deepcopy(document)
    inner: Any = copied
    for key in path[:-1]:
        inner = inner[key]
    if drop:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return copied


FOURIER, SPLINE = trajectory_to_json(smooth()), spline_document()
SERIES, POINTS = FOURIER["motion"]["coefficients"]["j1"], SPLINE["motion"]["control_points"]["j1"]
KNOTS = SPLINE["motion"]["knots"]
UNLIKE = {"family": "sum", "parts": [FOURIER["motion"], trajectory_to_json(smooth(3.0))["motion"]]}


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ([], 'run.json: is not a trajectory: .*begins with "echelon_trajectory": 1'),
        ({"coordinates": []}, "run.json: is not a trajectory"),
        (changed(FOURIER, "echelon_trajectory", value=2), "not a trajectory of this format: .* should be 1"),
        (changed(FOURIER, "echelon_trajectory", value="1"), "echelon_trajectory: .* should be 1"),
        (changed(FOURIER, "units", drop=True), "units: .* required"),
        (changed(FOURIER, "units", value=["rad"]), "units: has 1 entries for 2 coordinates"),
        (changed(FOURIER, "units", 0, value="deg"), "units.0: .* should be 'rad' or 'm'"),
        (changed(FOURIER, "coordinates", value=["j1", "j1"]), "coordinates: 'j1' occurs twice"),
        (changed(FOURIER, "coordinates", value=[]), "coordinates: .* at least 1 item"),
        (changed(FOURIER, "coordinates", value=["j1"]), "units: has 2 entries for 1 coordinates"),
        (
            changed(FOURIER, "motion", "coefficients", "j2", value=SERIES),
            r"motion.coefficients: 'j2' is not among the document's coordinates \['j1', 'slider'\]",
        ),
        (changed(FOURIER, "coordinates", value=["j1", "j2"]), "motion.coefficients: the coordinate 'j2' is missing"),
        (changed(FOURIER, "motion", "family", value="forier"), "motion: .*'forier'.*'fourier', 'splines', 'sum'"),
        (changed(FOURIER, "motion", "family", drop=True), "motion: .*'family'"),
        (changed(FOURIER, "motion", value=3), "motion: .* should be a valid dictionary"),
        (changed(FOURIER, "motion", "period", value=3), "motion.fourier.period: .* not permitted"),
        (changed(FOURIER, "motion", "duration", value=0), "duration: .* should be greater than or equal to"),
        (changed(FOURIER, "motion", "duration", value=float("inf")), "duration: .* should be a finite number"),
        (changed(FOURIER, "motion", "duration", value="2"), "duration: .* should be a valid number"),
        (changed(FOURIER, "motion", "harmonics", value=0), "harmonics: .* should be greater than or equal to 1"),
        (changed(FOURIER, "motion", "harmonics", value=3), "coefficients.j1.sin: has 2 entries; needs 3"),
        (changed(FOURIER, "motion", "harmonics", value=2.5), "harmonics: .* should be a valid integer"),
        (changed(FOURIER, "motion", "coefficients", "j1", "cos", value=[1.0]), "j1.cos: has 1 entries; needs 2"),
        (changed(FOURIER, "motion", "coefficients", "j1", "cos", 1, value=float("nan")), "cos.1: .* should be a fin"),
        (changed(FOURIER, "motion", "coefficients", "j1", "constant", value=10**400), "j1.constant: .* should be a"),
        (changed(FOURIER, "motion", "coefficients", "j1", "sin", drop=True), "j1.sin: .* required"),
        (changed(SPLINE, "motion", "degree", value=0), "degree: .* should be greater than or equal to 5"),
        (changed(SPLINE, "motion", "degree", value=4), "degree: .* should be greater than or equal to 5"),
        (changed(SPLINE, "motion", "degree", value=10**9), "motion.knots: of degree 1000000000 begin"),
        (changed(SPLINE, "motion", "knots", value=KNOTS[:-1]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", value=[]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", value=[k + 1 for k in KNOTS]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", 7, value=KNOTS[6]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "control_points", "j1", value=POINTS[1:]), "j1: has 7 entries; 14 knots .* need 8"),
        (changed(SPLINE, "motion", "control_points", "j1", 0, value=None), "j1.0: .* should be a valid number"),
        (changed(SPLINE, "motion", "control_points", "j1", drop=True), "points: the coordinate 'j1' is missing"),
        (changed(FOURIER, "motion", value=UNLIKE), r"motion.parts\[1\]: lasts 3.0 s, the first part 2.0 s"),
        (changed(FOURIER, "motion", value=UNLIKE | {"parts": []}), "parts: .* at least 1"),
        (
            changed(changed(FOURIER, "motion", value=UNLIKE), "motion", "parts", 0, "coefficients", "j1", drop=True),
            r"motion.parts\[0\].coefficients: the coordinate 'j1' is missing",
        ),
    ],
)  # fmt: skip
def test_documents_that_are_wrong(document: Any, problem: str) -> None:
    with pytest.raises(InputError, match=problem) as caught:
        trajectory_from_json(document, "run.json")
    assert str(caught.value).startswith("run.json: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (b"{", r"not well-formed JSON: .* \(line 1\)"),
        (b"\xff\xfe", "not UTF-8 text"),
        (b"[" * 200_000, "nested too deeply|not well-formed"),
        (b'{"echelon_trajectory": 1, "echelon_trajectory": 1}', "the key 'echelon_trajectory' occurs twice"),
        (b'{"echelon_trajectory": ' + b"1" * 5000 + b"}", "not readable as JSON"),
        (b"", "is empty"),
    ],
)
def test_files_that_are_no_documents(text: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_bytes(text)
    with pytest.raises(InputError, match=problem):
        read_trajectory(path, NAMES, UNITS)


def test_coordinates_of_documents_are_compared(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    write_trajectory(smooth(), path, 100)
    for names, units, problem in (
        (["j1", "j2"], UNITS, "coordinates: the coordinate 'j2' is missing; there are 'j1', 'slider'"),
        (["slider"], ["m"], "coordinates: there is no coordinate for 'j1'; valid are 'slider'"),
        (NAMES, ["rad", "rad"], "units: 'slider' is in m; needs rad"),
    ):
        with pytest.raises(InputError, match=problem):
            read_trajectory(path, names, units)
