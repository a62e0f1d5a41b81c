"""Settings of the preparation of logs: what is filtered, how it is differentiated, and what is left out."""

from __future__ import annotations

from pydantic import Field

from echelon.formats.schema.schema_log import PreparationEntry


class Preparation(PreparationEntry):
    """How a log becomes samples for least squares: the section of a set-up, with what was chosen from the data."""

    reasons: dict[str, str] = Field({}, description="For settings that were chosen: why, in a sentence.")
