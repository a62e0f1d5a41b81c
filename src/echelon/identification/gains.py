"""Unknown drive gains: motor constants from runs without and with a load that is known.

Currents i instead of torques make the equation homogeneous, 0 = X̄ ζ̄ − i K: every multiple of a solution is one, and
data tell ratios only.  Something known, a payload that was weighed or one gain, moves to the other side and fixes the
scale (Gautier and Briot, "Global identification of joint drive gains and dynamic parameters of robots", ASME J. Dynamic
Systems, Measurement and Control 136, 2014).

Noise sits in the currents, which are columns here, so that plain least squares shrinks the gains.  Solved for the
currents, i_j = (x̄_jᵀ ζ̄ + known_j)/K_j, the same equation has its noise on the left again; that nonlinear least
squares, with each drive's own noise, is the maximum likelihood (:mod:`echelon.identification.current_fit`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.base import BaseModel, base_of, base_parameters
from echelon.compute import Layout, Observation
from echelon.identification.current_fit import fit_currents, gain_names
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.fit import known_values
from echelon.identification.logs.files.open_log import log_paths
from echelon.identification.logs.preparation.choices import Signals, chosen
from echelon.identification.logs.read_log import read_log
from echelon.identification.logs.recording import Samples, Segment
from echelon.identification.payload import Payload, loaded_rows, with_zeros
from echelon.identification.rows.plan import LogPlan
from echelon.identification.rows.rows import ModelRows, RowStream
from echelon.identification.setup.setup import Setup, check_single, setup_of
from echelon.robot import Mechanism, Readable
from echelon.shared import Floats, InputError, public


@dataclass(frozen=True, repr=False)
class GainEstimate:
    """Drive gains, and all that was estimated with them.

    Attributes
    ----------
    drives, units : tuple of str
        Names of the gains, such as ``Kt1``, and their SI units.
    gains, std : array of shape (k,)
        Values and standard deviations; a gain that was given has standard deviation 0.
    estimate : Estimate
        Base parameters of the robot, gains among them, then those of the payload.
    scale : str
        What fixes the common scale, in words.
    unclear : tuple of str
        Gains whose 95 % intervals reach zero: the data do not determine them.
    """

    drives: tuple[str, ...]
    units: tuple[str, ...]
    gains: Floats
    std: Floats
    estimate: Estimate
    scale: str
    unclear: tuple[str, ...]

    def interval(self, level: float = 0.95) -> Floats:
        """Confidence intervals of the gains, shape (k, 2).

        Parameters
        ----------
        level : float
            Probability that an interval covers the true value.
        """
        places = [self.estimate.parameters.index(name) for name in self.drives]
        return self.estimate.interval(level)[places]

    def __repr__(self) -> str:
        some = zip(self.drives, self.gains, self.std, self.units, strict=True)
        gains = ", ".join(f"{n} = {g:.4g} ± {s:.2g} {u}" for n, g, s, u in some)
        return f"GainEstimate({gains}; ± one standard deviation)"


@public
def drive_gains(
    base: BaseModel | Mechanism | Readable,
    unloaded: Observation | RowStream,
    loaded: Observation | RowStream | None = None,
    payload: Payload | None = None,
    *,
    known: Mapping[str, float] | None = None,
) -> GainEstimate:
    """Drive gains and base parameters together.

    Parameters
    ----------
    base : BaseModel, Mechanism or path-like
        Of the robot, or its file, with ``drive_gain`` effects; outputs y are zero where a gain is unknown, currents are
        inputs.
    unloaded : Observation or Rows
        Runs without the payload, in the parameters of ``base``.
    loaded : Observation or Rows, optional
        Runs with it, in the parameters of ``base``, then of ``payload.base(base)``: see
        :func:`echelon.identification.payload.loaded_rows`.
    payload : Payload, optional
    known : mapping of str to float, optional
        Base parameters or gains that are known, by name, SI units.

    Returns
    -------
    GainEstimate

    Raises
    ------
    InputError
        If there are no gains, arguments do not fit together, nothing fixes the scale of some drives, or the data do not
        determine all parameters.
    """
    base = base_of(base)
    gains = gain_names(base)
    if not gains:
        raise InputError(
            "the model has no drive gains; add effects of type drive_gain, whose inputs are the currents"
        )
    if (loaded is None) != (payload is None):
        raise InputError(
            "a loaded run and its payload belong together; give both or neither"
        )
    free = _observation(unloaded, base.pivots, "the unloaded runs")
    fixed, units, words = (
        dict(known or {}),
        base.units,
        [f"{n} = {v:g}" for n, v in (known or {}).items() if v],
    )
    if loaded is not None and payload is not None:
        load = payload.base(base)
        carrying = _observation(loaded, base.pivots + load.pivots, "the loaded runs")
        free, units = free.extended(carrying.layout) + carrying, units + load.units
        fixed |= _load_values(payload, load)
        words.append(
            f"the payload on {payload.body}, of which {', '.join(payload.known)} known"
        )
    _check_zero(free, gains)
    rest = known_values(free.layout.parameters, units, fixed)
    reduced = rest.observation(free)
    _check_scale(reduced, gains)
    found = fit_currents(
        reduced, rest.unknown_units, _gain_of_output(reduced.layout, gains)
    )
    return _gains_of(
        rest.restored(found), gains, " and ".join(words) or "measured outputs"
    )


def _gains_of(estimate: Estimate, gains: tuple[str, ...], scale: str) -> GainEstimate:
    places = [estimate.parameters.index(name) for name in gains]
    interval = estimate.interval()[places]
    unclear = tuple(
        name
        for name, (low, high) in zip(gains, interval, strict=True)
        if low < 0 < high
    )
    units = tuple(estimate.units[k] for k in places)
    return GainEstimate(
        gains,
        units,
        estimate.values[places],
        estimate.std[places],
        estimate,
        scale,
        unclear,
    )


# -- data -------------------------------------------------------------------------------------------------------------


def _observation(
    data: Observation | RowStream, parameters: tuple[str, ...], what: str
) -> Observation:
    found = data if isinstance(data, Observation) else data.observation()
    if found.layout.parameters != parameters:
        raise InputError(
            f"{what} have {len(found.layout.parameters)} parameters; expected {len(parameters)}: "
            f"{', '.join(parameters[:3])}, … {parameters[-1]} (loaded_rows() puts a payload's beside the robot's)"
        )
    return found


def _load_values(payload: Payload, load: BaseModel) -> dict[str, float]:
    found = payload.known_values(load)
    if not any(found.values()):
        raise InputError(
            f"its known parameters ({', '.join(payload.known)}) cannot be separated from the unknown ones, or no "
            "output depends on them: measure more of its parameters, or put it on a body further out",
            element=f"payload on '{payload.body}'",
        )
    return found


def _check_zero(observation: Observation, gains: Sequence[str]) -> None:
    """Refuse measured values beside unknown gains: currents given twice would be explained by gains of −1."""
    of_output = _gain_of_output(observation.layout, gains)
    for label, R, some in zip(
        observation.layout.outputs, observation.factors, of_output, strict=True
    ):
        if some and np.abs(R[:, -1]).max(initial=0.0) > 0:
            raise InputError(
                "its currents are multiplied by an unknown gain, so its measured value y must be zero",
                element=f"output '{label}'",
            )


def _gain_of_output(
    layout: Layout, gains: Sequence[str]
) -> tuple[tuple[str, ...], ...]:
    """For each output the gains that it depends on."""
    return tuple(
        tuple(layout.parameters[c] for c in some if layout.parameters[c] in gains)
        for some in layout.columns
    )


def _check_scale(observation: Observation, gains: Sequence[str]) -> None:
    """Refuse drives whose equations stay homogeneous: outputs that share parameters share their scale."""
    layout = observation.layout
    for outputs, parameters in _sharing(layout):
        lost = [
            layout.parameters[c]
            for c in sorted(parameters)
            if layout.parameters[c] in gains
        ]
        if lost and not any(
            np.abs(observation.factors[k][:, -1]).max(initial=0.0) for k in outputs
        ):
            raise InputError(
                f"0 = X ζ − i K holds for every multiple of a solution, so the data determine only ratios of "
                f"{', '.join(lost)} and the masses: add runs with a payload of known mass, or give a known parameter, "
                "such as one gain from a data sheet"
            )


def _sharing(layout: Layout) -> list[tuple[set[int], set[int]]]:
    """Outputs that share parameters, with all that they depend on."""
    groups: list[tuple[set[int], set[int]]] = []
    for output, columns in enumerate(layout.columns):
        outputs, parameters = {output}, set(columns)
        for group in [g for g in groups if g[1] & parameters]:
            groups.remove(group)
            outputs |= group[0]
            parameters |= group[1]
        groups.append((outputs, parameters))
    return groups


Paths = Sequence[str | os.PathLike[str]]


@public
def gains_from_logs(
    setup: Setup | Readable,
    unloaded: Paths,
    loaded: Paths = (),
    payload: Payload | None = None,
    *,
    known: Mapping[str, float] | None = None,
) -> GainEstimate:
    """Drive gains and base parameters from logs of currents.

    Parameters
    ----------
    setup : Setup or path-like
        A robot, or its file, with ``drive_gain`` effects, whose logs have currents as inputs and need no outputs.
    unloaded : sequence of path
        Runs without the payload; a directory stands for all logs in it.
    loaded : sequence of path, optional
        Runs with it.
    payload : Payload, optional
        The known parameters of the load.
    known : mapping of str to float, optional
        Base parameters or gains that are known, by name, SI units.

    Returns
    -------
    GainEstimate

    Raises
    ------
    InputError
        If logs cannot be read, or nothing fixes the scale: see :func:`drive_gains`.
    """
    if bool(loaded) != (payload is not None):
        raise InputError(
            "runs with a payload and the payload itself go together: give both or neither"
        )
    setup = check_single(setup_of(setup))
    base = base_parameters(setup.mechanism, seed=setup.seed)
    plan = _plan(setup, base, unloaded)
    rows = ModelRows.of(base, _samples(plan, unloaded))
    if payload is None:
        return drive_gains(base, rows, known=known)
    return drive_gains(
        base,
        rows,
        loaded_rows(base, payload, _samples(plan, loaded)),
        payload,
        known=known,
    )


def _plan(setup: Setup, base: BaseModel, logs: Paths) -> LogPlan:
    """Settings chosen from the runs without a load; they hold for all."""
    segments: list[Segment] = []
    for path in log_paths(logs):
        for piece in read_log(
            path,
            setup.mechanism,
            setup.columns,
            rate=setup.preparation.rate,
            outputs=False,
        ):
            segments += piece.segments
    return LogPlan(
        base,
        setup.columns,
        chosen(setup.preparation, Signals.of(segments, setup.mechanism)),
    )


def _samples(plan: LogPlan, logs: Paths) -> list[Samples]:
    paths = log_paths(logs)
    return [
        with_zeros(plan.base, some)
        for path in paths
        for some in plan.samples(path, outputs=False)
    ]
