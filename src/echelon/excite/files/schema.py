"""The versioned JSON schema of trajectories.

A document says how its numbers are to be evaluated, in words that travel with them: whoever runs the motion on a robot
needs the file and nothing else.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Discriminator, Field

from echelon.excite.trajectory import DURATIONS

VERSION = 1
"""Of the format."""

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
