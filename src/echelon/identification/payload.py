"""Runs with a payload: its columns beside those of the robot.

A payload that is rigidly on a body only adds to that body's parameters, so that the loaded robot alone cannot tell the
two apart.  Beside runs without it the payload is a set of columns of its own: the base regressor of the same mechanism
with all masses but the payload's taken away.  Parameters of it that are known fix the scale of drive gains; those that
are not stay unknowns, and come first among the representatives, so that what is known stands in columns of its own
wherever the motion can tell it from what is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from echelon.base import BaseModel, base_parameters
from echelon.compute import Layout
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.rows import ModelRows, RowBlock, RowStream
from echelon.robot import ALL
from echelon.shared import PARAMETERS, PER_BODY, Floats, InputError, nearest_of, public

LABEL = "_payload"  # ends the names of a payload's parameters: ``M_payload``


@public
@dataclass(frozen=True)
class Payload:
    """A load that is rigidly on a body.

    Attributes
    ----------
    body : str
        Name of the body.
    known : mapping of str to float
        Those of its ten parameters XX … M that are known, SI units, about the origin of the body's frame and along its
        axes; :func:`echelon.convert` brings other forms there.

    Raises
    ------
    InputError
        If a parameter does not exist or is not finite, or none is known.

    Examples
    --------
    >>> Payload("link6", {"M": 4.9}).unknown[-1]
    'MZ'
    """

    body: str
    known: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        where = f"payload on '{self.body}'"
        for kind, value in self.known.items():
            if kind not in PARAMETERS:
                raise InputError(
                    f"'{kind}' is not a parameter of a body{nearest_of(kind, PARAMETERS)}",
                    element=where,
                )
            if not np.isfinite(value):
                raise InputError(
                    f"{kind} is {value}; expected a finite number", element=where
                )
        if not any(self.known.values()):
            raise InputError(
                "no parameter of it is known and not zero; weigh it and give its mass M",
                element=where,
            )

    @staticmethod
    def of(body: str, standard: Sequence[float] | Floats) -> Payload:
        """A payload of which all is known.

        Parameters
        ----------
        body : str
        standard : array of shape (10,)
            XX … M about the origin of the body's frame, SI units.
        """
        values = np.asarray(standard, dtype=float)
        if values.shape != (PER_BODY,):
            raise InputError(
                f"a payload has {PER_BODY} standard parameters; got an array of shape {values.shape}"
            )
        return Payload(body, dict(zip(PARAMETERS, values.tolist(), strict=True)))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Kinds of parameters that are not known."""
        return tuple(kind for kind in PARAMETERS if kind not in self.known)

    def base(self, base: BaseModel) -> BaseModel:
        """Base parameters of the payload alone, on the robot of a base model.

        Parameters
        ----------
        base : BaseModel
            Of the robot; geometry, gravity and outputs are taken from it.

        Returns
        -------
        BaseModel
            Parameters ``XX_payload`` … ``M_payload``, unknown ones first among the representatives.

        Raises
        ------
        InputError
            If the robot has no such body, or no output sees it.
        """
        mechanism = base.mechanism
        names = [body.name for body in mechanism.bodies]
        if self.body not in names:
            raise InputError(
                f"there is no body '{self.body}'{nearest_of(self.body, names)}",
                element="payload",
            )
        place = names.index(self.body)
        bodies = tuple(
            replace(body, label=LABEL, carried=ALL, inertial=None)
            if k == place
            else replace(body, carried=())
            for k, body in enumerate(mechanism.bodies)
        )
        alone = replace(
            mechanism, name=f"payload on {self.body}", bodies=bodies, effects=()
        )
        found = base_parameters(
            alone,
            prefer=[kind + LABEL for kind in (*self.unknown, *self.known)],
            seed=base.seed,
        )
        if not found.rank:
            raise InputError(
                f"no output sees a load on '{self.body}': put it on a body that moves",
                element="payload",
            )
        return found

    def known_values(self, load: BaseModel) -> dict[str, float]:
        """Base parameters of the payload that follow from what is known.

        Parameters
        ----------
        load : BaseModel
            From :meth:`base`.

        Returns
        -------
        dict of str to float
        """
        standard = np.array([self.known.get(kind, np.nan) for kind in PARAMETERS])
        found = {}
        for name, row in zip(load.pivots, load.B_float(), strict=True):
            used = row != 0
            if np.isfinite(standard[used]).all():
                found[name] = float(row[used] @ standard[used])
        return found


@dataclass(frozen=True, repr=False)
class JoinedRows(RowStream):
    """Rows whose columns are those of two sets of rows side by side."""

    first: RowStream  # of the same samples; measured outputs are the first's
    second: RowStream  # of the same samples; measured outputs are the first's

    def __post_init__(self) -> None:
        a, b = self.first.layout, self.second.layout
        if a.outputs != b.outputs or set(a.parameters) & set(b.parameters):
            raise InputError(
                "rows to be joined need the same outputs and different parameters"
            )

    @property
    def layout(self) -> Layout:
        """Outputs, and the parameters of both."""
        a, b = self.first.layout, self.second.layout
        shift = len(a.parameters)
        columns = tuple(
            (*p, *(shift + c for c in q))
            for p, q in zip(a.columns, b.columns, strict=True)
        )
        return Layout(a.outputs, a.parameters + b.parameters, columns)

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the parameters of both."""
        return self.first.units + self.second.units

    def blocks(self) -> Iterator[RowBlock]:
        """All rows, in the order of time, log after log."""
        for one, two in zip(self.first.blocks(), self.second.blocks(), strict=True):
            if not all(
                np.array_equal(s, t) for s, t in zip(one.times, two.times, strict=True)
            ):
                raise InputError(
                    "rows to be joined are of different times", source=one.source
                )
            pairs = zip(one.matrices, two.matrices, strict=True)
            yield replace(
                one, matrices=tuple(np.concatenate(pair, axis=1) for pair in pairs)
            )


def loaded_rows(
    base: BaseModel, payload: Payload, samples: Sequence[Samples]
) -> JoinedRows:
    """Rows of a run with a payload, for :func:`echelon.identification.gains.drive_gains`."""
    filled = [with_zeros(base, some) for some in samples]
    return JoinedRows(
        ModelRows.of(base, filled), ModelRows.of(payload.base(base), filled)
    )


def with_zeros(base: BaseModel, samples: Samples) -> Samples:
    """Samples of a homogeneous equation, whose left-hand side is zero where no outputs are measured."""
    if samples.y is not None:
        return samples
    return replace(samples, y=np.zeros((len(samples), len(base.mechanism.outputs))))
