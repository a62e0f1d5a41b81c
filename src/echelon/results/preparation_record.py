"""What an identified model says about logs: their columns and how they were prepared, typed and checked."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field
from pydantic import BaseModel as Schema

from echelon.logs.columns.column_map import Channel, ColumnMap
from echelon.logs.preparation.settings import Preparation

Positive = Annotated[float, Field(gt=0)]
CutOff = Annotated[Positive | Literal["inf"] | None, AfterValidator(lambda c: c if c is None else float(c))]
Stages = Annotated[list[Annotated[int, Field(ge=1, le=10**6)]] | None, Field(max_length=20)]
NotNegative = Annotated[float, Field(ge=0)]


class _Strict(Schema):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ChannelRecord(_Strict):
    """A quantity in a column: scale · (column in SI units) + offset."""

    column: str
    unit: str
    scale: float
    offset: float

    def made(self) -> Channel:
        """As it is used."""
        return Channel(self.column, self.unit, self.scale, self.offset)


Channels = dict[str, ChannelRecord]


class ColumnMapRecord(_Strict):
    """Which columns of logs hold which quantities."""

    time: ChannelRecord | None
    rate: Positive | None
    positions: Channels
    velocities: Channels
    accelerations: Channels
    outputs: Channels
    references: Channels
    inputs: Channels

    def made(self) -> ColumnMap:
        """As it is used."""
        kinds = ("positions", "velocities", "accelerations", "outputs", "references", "inputs")
        channels = {kind: {name: c.made() for name, c in getattr(self, kind).items()} for kind in kinds}
        return ColumnMap(None if self.time is None else self.time.made(), self.rate, **channels)


class PreparationRecord(_Strict):
    """How logs were prepared, every choice filled in."""

    cutoff: CutOff = Field(description="Of the low-pass over positions, Hz; 'inf' for none.")
    order: int = Field(ge=1, le=100, description="Of that Butterworth filter.")
    derivative: Literal["central", "savitzky_golay", "fourier"]
    measured: list[Literal["qd", "qdd"]]
    period: Positive | None
    average: bool
    output_cutoff: CutOff = Field(description="Of the filter over both sides of the equation, Hz; 'inf' for none.")
    output_filter: Literal["butterworth", "chebyshev", "fir"]
    decimation: Stages
    still: NotNegative | dict[str, NotNegative] | None
    delays: dict[str, float] | None
    trim: NotNegative
    rate: Positive | None
    chosen_at: Positive | None
    reasons: dict[str, str]

    def made(self) -> Preparation:
        """As it is used."""
        stated: dict[str, Any] = self.model_dump()
        tuples = {key: tuple(stated[key]) for key in ("measured", "decimation") if stated[key] is not None}
        return Preparation(**{**stated, **tuples})
