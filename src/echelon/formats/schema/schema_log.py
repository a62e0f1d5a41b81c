"""What a log's columns mean, how it is prepared and what is fitted, as data models of the description format."""

from __future__ import annotations

from math import inf
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from echelon.choices import Criterion, Estimator, Values
from echelon.formats.schema.schema_geometry import Model
from echelon.formats.schema.schema_types import (
    AS_LIST,
    Expression,
    Flag,
    Name,
    kind_of,
    mapping_or_expression,
    refusal,
)

_Triples = tuple[tuple[float, float, float], tuple[float, float, float]]


def _real(value: object) -> float:
    try:
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError
        number = float(value)
    except ValueError:
        raise refusal(f"needs a number, found {kind_of(value)}") from None
    if number != number:
        raise refusal("needs a number, found nan")
    return number


def _whole(value: object) -> int:
    number = _real(value)
    if number != int(number) or number < 1:
        raise refusal(f"needs a whole number from 1 on, found {kind_of(value)}")
    return int(number)


def _range(value: tuple[float, float]) -> tuple[float, float]:
    low, high = value
    if low > high or low == inf or high == -inf:
        raise refusal(f"nothing is between {low:g} and {high:g}")
    return value


def _mass(value: tuple[float, float]) -> tuple[float, float]:
    return _range((max(value[0], 0.0), value[1]))


def _box(value: _Triples) -> _Triples:
    if not all(-inf < low <= high < inf for low, high in zip(*value, strict=True)):
        raise refusal("the first corner of the box must not exceed the second")
    return value


def _ellipsoid(value: _Triples) -> _Triples:
    if not all(abs(centre) < inf and 0 < axis < inf for centre, axis in zip(*value, strict=True)):
        raise refusal("the semi-axes of the ellipsoid must be positive")
    return value


def _stages(value: object) -> tuple[object, ...]:
    return tuple(value) if isinstance(value, list | tuple) else (value,)


def _auto(value: object) -> object:
    return None if value == "auto" else value


def _listed(value: object) -> object:
    return None if value is None or value == "auto" else _stages(value)


Real = Annotated[float, BeforeValidator(_real), WithJsonSchema({"type": ["number", "string"]})]
Whole = Annotated[int, BeforeValidator(_whole), WithJsonSchema({"type": ["integer", "string"]})]
Positive = Annotated[Real, Field(gt=0)]
_Tuple = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Bound = Annotated[tuple[Real, Real], _Tuple, AfterValidator(_range)]
MassBound = Annotated[Bound, AfterValidator(_mass)]
Corner = Annotated[tuple[Real, Real, Real], _Tuple]
Box = Annotated[tuple[Corner, Corner], AS_LIST, AfterValidator(_box)]
Ellipsoid = Annotated[tuple[Corner, Corner], AS_LIST, AfterValidator(_ellipsoid)]
Automatic = BeforeValidator(_auto)
_DERIVATIVES = WithJsonSchema({"type": ["array", "string", "null"], "items": {"enum": ["qd", "qdd"]}})


def number_or_mapping(value: object) -> str:
    """Tag of a value that may be one number for all, or a mapping by name."""
    return "mapping" if isinstance(value, dict) else "number"


# -- columns --------------------------------------------------------------------------------------------------------


class ColumnEntry(Model):
    """A column and how its numbers become SI units: scale · (column in SI units) + offset."""

    column: Name = Field(description="Name of the column.", examples=["q_1"])
    unit: str = Field("", description="Unit of the column; default: the SI unit.", examples=["deg", "N·mm", "ms"])
    scale: Expression = Field("1", description="Sign, ratio or gain.", examples=["-1", "1/100", "35.15"])
    offset: Expression = Field("0", description="Added last, SI unit.", examples=["-pi/2"])


Column = Annotated[
    Annotated[Name, Tag("text")] | Annotated[ColumnEntry, Tag("mapping")], Discriminator(mapping_or_expression)
]
Columns = Annotated[
    Annotated[Name, Tag("text")] | Annotated[dict[str, Column], Tag("mapping")], Discriminator(mapping_or_expression)
]

_BY_NAME = (
    "{n} counts from 1, {i} from 0, {n+12} and {2*n-1} are numbers too, {name} is the name; all for every coordinate, "
    "actuators for every drive, "
    "or one by one, where names of actuators mean the motor's side."
)


class LogEntry(Model):
    """Columns of the logs."""

    time: Column | None = Field(
        None, description="Time stamps; default: those that messages of a bag have, or guessed.", examples=["t"]
    )
    rate: Positive | None = Field(None, description="Samples per second, without time stamps.", examples=[1000])
    position: Columns | None = Field(
        None, description=f"Positions. {_BY_NAME}", examples=["q_{n}", {"actuators": "motor_{n}"}]
    )
    velocity: Columns | None = Field(None, description="Velocities, if logged.", examples=["qd_{n}"])
    acceleration: Columns | None = Field(None, description="Accelerations, if logged.", examples=["qdd_{n}"])
    output: Columns | None = Field(
        None, description="Measured outputs; of actuators also where joints are the outputs.", examples=["tau_{n}"]
    )
    reference: Columns | None = Field(
        None, description="Positions that the controller was asked for.", examples=["q_ref_{n}"]
    )
    input: Columns | None = Field(None, description="Inputs that effects use.", examples=[{"j1": "current_1"}])

    @model_validator(mode="after")
    def _check_clock(self) -> Self:
        if self.time is not None and self.rate is not None:
            raise refusal("give time or rate, not both")
        return self


# -- preparation ----------------------------------------------------------------------------------------------------


class PreparationEntry(Model):
    """How logs become samples; what is absent, or auto, is chosen from the data."""

    band: Annotated[Positive | None, Automatic] = Field(
        None, description="What both sides of the equation keep, from 0 Hz up to this; inf for all.", examples=[5]
    )
    measured: Annotated[tuple[Literal["qd", "qdd"], ...] | None, BeforeValidator(_listed), _DERIVATIVES] = Field(
        None, description="Derivatives to take from the log; [] for none.", examples=[["qd"]]
    )
    still: (
        Annotated[
            Annotated[Real, Tag("number")] | Annotated[dict[str, Real], Tag("mapping")],
            Discriminator(number_or_mapping),
        ]
        | None
    ) = Field(None, description="Speed below which rows are left out, for all outputs or by output.", examples=[0.01])
    delays: dict[str, Real] | None = Field(
        None, description="Delay of outputs behind positions, s.", examples=[{"j1": 0.002}]
    )
    trim: Annotated[Real, Field(ge=0)] = Field(0.0, description="Left out at both ends, s.", examples=[0.5])
    rate: Positive | None = Field(None, description="Resample to this rate, Hz.", examples=[500])


# -- identification -------------------------------------------------------------------------------------------------


class BodyBoundsEntry(Model):
    """What is known about a body before anything is measured, about and along its own frame."""

    mass: MassBound | None = Field(None, description="Least and largest mass, kg.", examples=[[1, 5]])
    box: Box | None = Field(
        None,
        description="Box that holds the centre of mass: two opposite corners, m.",
        examples=[[[-0.1, -0.1, 0], [0.1, 0.1, 0.3]]],
    )
    ellipsoid: Ellipsoid | None = Field(
        None,
        description="Ellipsoid that holds it: centre and semi-axes, m.",
        examples=[[[0, 0, 0.1], [0.1, 0.1, 0.2]]],
    )
    extent: Ellipsoid | None = Field(
        None,
        description="Ellipsoid that holds all of the mass: centre and semi-axes, m.",
        examples=[[[0, 0, 0.05], [0.08, 0.08, 0.08]]],
    )
    symmetry: Annotated[tuple[Literal["xy", "xz", "yz", "x", "y", "z"], ...], BeforeValidator(_stages)] = Field(
        (), description="Planes to which, and axes about which, the mass is symmetric.", examples=[["xz"]]
    )


class PriorEntry(Model):
    """What was believed before."""

    file: Name | None = Field(
        None,
        description="Another description of the robot with inertial values, relative to this one; default: the "
        "values of this one.",
        examples=["arm.urdf"],
    )
    weight: Annotated[Positive | None, Automatic] = Field(
        None, description="Of the prior against the data; chosen from the data if absent.", examples=[1.0]
    )


class IdentificationEntry(Model):
    """What is fitted and how."""

    estimator: Estimator = Field("irls", description="Estimator of the base parameters.", examples=["irls"])
    known: dict[str, Real] = Field({}, description="Base parameters with known values.", examples=[{"Ia1": 0.1}])
    holdout: Annotated[Real, Field(ge=0, lt=1)] = Field(
        0.3, description="Share of each log kept for validation where no other log is.", examples=[0.3]
    )
    physical: Flag = Field(True, description="Fit a physically consistent robot as well.", examples=[False])
    predict: Values = Field("estimate", description="Which values predictions use.", examples=["physical"])
    essential: Literal[Criterion, "none"] = Field(
        "bic", description="Criterion that eliminates parameters.", examples=["bic"]
    )
    prior: PriorEntry = Field(PriorEntry.model_construct(), description="Prior values.")
    bodies: dict[str, BodyBoundsEntry] = Field(
        {}, description="Bounds on bodies.", examples=[{"link1": {"mass": [1, 5]}}]
    )
    parameters: dict[str, Bound] = Field({}, description="Bounds on parameters.", examples=[{"Fv1": [0, 10]}])
    total_mass: MassBound | None = Field(None, description="Range of the mass of all bodies, kg.", examples=[[12, 14]])
    intervals: Literal["clustered", "classical"] = Field(
        "clustered",
        description="Covariance from batches of time, which holds where residuals are not white, or the classical one.",
        examples=["classical"],
    )
    level: Annotated[Real, Field(gt=0, lt=1)] = Field(0.95, description="Of confidence intervals.", examples=[0.95])

    @model_validator(mode="before")
    @classmethod
    def _check_prediction(cls, data: Any) -> Any:
        if (
            isinstance(data, dict)
            and data.get("predict") == "physical"
            and str(data.get("physical")).lower() == "false"
        ):
            raise refusal("predictions cannot use a physical fit that is switched off")
        return data
