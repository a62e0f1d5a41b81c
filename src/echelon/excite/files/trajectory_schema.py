"""The versioned JSON schema of trajectories.

A document says how its numbers are to be evaluated, in words that travel with them: whoever runs the motion on a robot
needs the file and nothing else.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Discriminator, Field, ValidationError
from pydantic_core import ErrorDetails

from echelon.errors import InputError, one_line
from echelon.excite.problem.trajectory import DURATIONS
from echelon.hints import nearest_of

VERSION = 1
"""Version of the format."""

FOURIER = (
    "q(t) = constant + sum over k = 1 ... harmonics of sin[k-1] * sin(2 pi k t / duration) "
    "+ cos[k-1] * cos(2 pi k t / duration); periodic with the duration"
)
SPLINES = (
    "B-spline: q(t) = sum over i of control_points[i] * N[i](t), N[i] the B-spline of the degree on "
    "knots[i] ... knots[i + degree + 1]; from t = 0 to the last knot"
)
SUM = "the sum of the parts at each t"
EXPLANATION = (
    "Position of each coordinate in its unit over time t in s, as the motion's 'meaning' says; velocities, "
    "accelerations and jerks are the derivatives of the same formula."
)

Length = Annotated[float, Field(ge=DURATIONS[0], le=DURATIONS[1])]


class _Strict(Schema):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class FourierCoefficients(_Strict):
    """One coordinate's coefficients, in its unit."""

    constant: float
    sin: list[float] = Field(description="Of sin(2πkt/duration), k = 1, 2, …, harmonics.")
    cos: list[float] = Field(description="Of cos(2πkt/duration), k = 1, 2, …, harmonics.")


class FourierRecord(_Strict):
    """A finite Fourier series."""

    family: Literal["fourier"]
    meaning: str = FOURIER
    duration: Length = Field(description="The period, s.")
    harmonics: int = Field(ge=1)
    coefficients: dict[str, FourierCoefficients] = Field(description="By coordinate.")


class SplinesRecord(_Strict):
    """B-splines on knots that all coordinates share."""

    family: Literal["splines"]
    meaning: str = SPLINES
    degree: int = Field(ge=5)
    knots: list[float] = Field(
        description="s; the first, 0, and the last, the duration, occur degree + 1 times, the others once."
    )
    control_points: dict[str, list[float]] = Field(
        description="By coordinate, in its unit; as many as there are knots less degree + 1."
    )


class SumRecord(_Strict):
    """Motions of one duration on top of one another."""

    family: Literal["sum"]
    meaning: str = SUM
    parts: list[Motion] = Field(min_length=1)


Motion = Annotated[FourierRecord | SplinesRecord | SumRecord, Discriminator("family")]


class TrajectoryRecord(_Strict):
    """A trajectory; keys that are not named here say where it comes from and do not change it."""

    model_config = ConfigDict(extra="allow", title="Echelon trajectory")

    echelon_trajectory: Literal[1] = Field(description="Version of this format.")
    explanation: str = EXPLANATION
    coordinates: list[str] = Field(min_length=1, description="Names, each once.")
    units: list[Literal["rad", "m"]] = Field(description="Of each coordinate.")
    motion: Motion


def trajectory_schema() -> dict[str, Any]:
    """The JSON schema of the file."""
    return TrajectoryRecord.model_json_schema()


_KEY = "echelon_trajectory"
_FAMILIES = ("fourier", "splines", "sum")


def as_record(data: Any, source: str) -> TrajectoryRecord:
    """A document, checked against its schema."""
    if not isinstance(data, dict) or _KEY not in data:
        problem = f'is not a trajectory: the document of one is an object that begins with "{_KEY}": {VERSION}'
        raise InputError(problem, source=source)
    version = data[_KEY]
    if version != VERSION or isinstance(version, bool):
        problem = f"version {one_line(repr(version))[:40]} of the format is not known; valid is {VERSION}"
        raise InputError(problem, source=source, element=_KEY)
    try:
        return TrajectoryRecord.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        element = one_line(_path(data, first["loc"]))
        raise InputError(_message(first), source=source, element=element or None) from None


def _path(data: Any, location: tuple[int | str, ...]) -> str:
    """The element's path; a location also names the branches of unions, which the document does not have."""
    path = ""
    for part in location:
        if isinstance(data, dict) and part in data:
            path, data = f"{path}.{part}" if path else str(part), data[part]
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            path, data = f"{path}[{part}]", data[part]
    return path


def _message(problem: ErrorDetails) -> str:
    kind = problem["type"]
    if kind == "missing":
        return f"the key '{problem['loc'][-1]}' is missing"
    if kind == "union_tag_not_found":
        return f"the key 'family' is missing (valid: {', '.join(_FAMILIES)})"
    if kind == "union_tag_invalid":
        tag = one_line(str(problem.get("ctx", {}).get("tag")))
        return f"the family '{tag}' is not known{nearest_of(tag, _FAMILIES)}"
    if kind == "extra_forbidden":
        return "is not a key of the format"
    return problem["msg"].replace("Input should", "should", 1)
