"""Essential parameters: the smaller model that is left when parameters which the data do not need are taken out.

Backward elimination, one parameter at a time, on the R-factor: taking a column out is a small QR, and by how much the
residual grows is known before, Δ_j = ζ̂_j² / [(WᵀW)⁻¹]_jj.  Weights stay those of the full model all the way, so that
criteria of different models compare.  Three criteria decide when to stop:

``"bic"``
    Bayesian information N ln(ρ²/N) + k ln N falls with every elimination (Schwarz 1978).  The default: it finds the
    true model as data grow, and has no knob.
``"f-test"``
    The F-test of the least significant parameter does not reject that it is zero.
``"relative_std"``
    The largest relative standard deviation exceeds a multiple of the smallest (Pham and Gautier, "Essential parameters
    of robots", CDC 1991).  Customary in robotics.  It also drops parameters that are small but well seen, such as
    offsets near zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.hints import nearest_of
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.leverage import residual_deviations
from echelon.identification.estimators.submodel import Submodel
from echelon.observe.observation import Observation, checked_weights
from echelon.observe.triangle import Triangle, upper_triangle

Criterion = Literal["bic", "f-test", "relative_std"]

RATIO = 10.0
"""Multiple of the smallest relative standard deviation from which on a parameter is dropped; customary are 10 to 30."""
LEVEL = 0.05
"""Significance of the F-test."""


def essential(
    observation: Observation,
    units: Sequence[str],
    noise: Sequence[float] | Floats | None = None,
    *,
    criterion: Criterion = "bic",
    ratio: float = RATIO,
    level: float = LEVEL,
    keep: Sequence[str] = (),
    correlation: float = 1.0,
) -> Estimate:
    """Least squares with the essential parameters only, found by backward elimination.

    Parameters
    ----------
    observation : Observation
    units : sequence of str
        SI units of the n parameters.
    noise : array of shape (m,), optional
        Standard deviation of each output's noise; that of the residual of its own full fit if omitted.
    criterion : "bic", "f-test" or "relative_std"
        When to stop; see :mod:`echelon.identification.estimators.essential`.
    ratio : float
        For ``"relative_std"``: multiple of the smallest one.
    level : float
        For ``"f-test"``: significance.
    keep : sequence of str
        Parameters that stay in any case.
    correlation : float
        Rows that a residual stays correlated for (its integrated autocorrelation time in rows): so many rows count as
        one.  1 for white noise.

    Returns
    -------
    Estimate
        Values and standard deviations of eliminated parameters are 0.  Diagnostics hold ``criterion``, ``eliminated``,
        ``kept`` and ``history``: a record for each elimination with the ``parameter``, the model's criterion ``before``
        and ``after`` (BIC, the p-value of its least significant parameter, or the ratio of its largest to its smallest
        relative standard deviation; None for parameters that the data do not determine, which go first), and the
        ``rms`` of the weighted residual.

    Raises
    ------
    InputError
        If arguments do not fit, or there are fewer rows than parameters that would stay.

    Examples
    --------
    >>> from echelon.observe.layout import Layout
    >>> rng = np.random.default_rng(1)
    >>> W = rng.normal(size=(100, 3))
    >>> y = W @ [2.0, 0.0, -1.0] + 0.1 * rng.normal(size=100)
    >>> seen = Observation.of(Layout(("tau",), ("a", "b", "c"), ((0, 1, 2),)), [np.linalg.qr(np.c_[W, y])[1]], 100)
    >>> essential(seen, ["kg"] * 3).diagnostics["eliminated"]
    ['b']
    """
    names = observation.layout.parameters
    _check(observation, units, criterion, ratio, level, keep, correlation)
    weights = _weights(observation, noise)
    triangle = observation.combined(weights)
    rows = triangle.rows / correlation
    kept, history = _determined(triangle, {names.index(name) for name in keep})
    model = Submodel(kept, upper_triangle(_augmented(triangle)[:, [*kept, len(names)]]), rows)
    protected = {names.index(name) for name in keep}
    while model.kept:
        place = _candidate(model, criterion, protected)
        if place is None or not _goes(model, place, criterion, ratio, level):
            break
        smaller = model.without(place)
        before, after = _value(model, criterion), _value(smaller, criterion)
        history.append(_record(names[model.kept[place]], before, after, smaller))
        model = smaller
    return _estimate(observation, units, weights, model, history, criterion, correlation)


# -- criteria ---------------------------------------------------------------------------------------------------------


def _candidate(model: Submodel, criterion: Criterion, protected: set[int]) -> int | None:
    """Place of the parameter that the criterion would drop first."""
    worst = model.relative if criterion == "relative_std" else -model.growth
    free = [place for place, parameter in enumerate(model.kept) if parameter not in protected]
    return max(free, key=lambda place: worst[place]) if free else None


def _goes(model: Submodel, place: int, criterion: Criterion, ratio: float, level: float) -> bool:
    if criterion == "bic":
        return _value(model.without(place), "bic") < _value(model, "bic")
    if criterion == "f-test":
        return _significance(model, place) > level
    relative = model.relative
    return bool(relative[place] > ratio * relative.min())


def _value(model: Submodel, criterion: Criterion) -> float:
    """The criterion of a whole model."""
    if criterion == "bic":
        spread = max(model.squares, float(np.finfo(float).tiny)) / model.rows
        return float(model.rows * np.log(spread) + len(model.kept) * np.log(model.rows))
    if not model.kept:
        return 0.0
    if criterion == "f-test":
        return _significance(model, int(np.argmin(model.growth)))
    relative = model.relative
    return float(relative.max() / relative.min()) if relative.min() else float("inf")


def _significance(model: Submodel, place: int) -> float:
    """p-value of the hypothesis that a parameter is zero."""
    from scipy.stats import f

    return float(f.sf(model.growth[place] / model.variance, 1, model.degrees))


# -- beginning and end ------------------------------------------------------------------------------------------------


def _determined(triangle: Triangle, protected: set[int]) -> tuple[tuple[int, ...], list[dict[str, Any]]]:
    """Parameters without those that the data leave open in the others' presence: taking them out costs nothing."""
    from scipy.linalg import qr

    n = len(triangle.parameters)
    if triangle.rank == n:
        return tuple(range(n)), []
    scaled = triangle.R / np.where(triangle.scales == 0, 1.0, triangle.scales)
    # column pivoting takes what stays first by size; what must stay is made large
    preference = np.array([1e3 if k in protected else 1.0 for k in range(n)])
    order = qr(scaled * preference, mode="r", pivoting=True)[1]
    kept = tuple(sorted(int(k) for k in order[: triangle.rank]))
    lost = protected - set(kept)
    if lost:
        raise InputError(f"the data do not determine '{triangle.parameters[min(lost)]}', which is to stay")
    gone = [triangle.parameters[k] for k in range(n) if k not in kept]
    rms = triangle.residual / np.sqrt(max(triangle.rows, 1))
    return kept, [{"parameter": name, "before": None, "after": None, "rms": float(rms)} for name in gone]


def _augmented(triangle: Triangle) -> Floats:
    n = len(triangle.parameters)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n], whole[n, n] = triangle.R, triangle.qty, triangle.residual
    return whole


def _record(name: str, before: float, after: float, model: Submodel) -> dict[str, Any]:
    return {"parameter": name, "before": before, "after": after, "rms": float(np.sqrt(model.squares / model.rows))}


def _weights(observation: Observation, noise: Sequence[float] | Floats | None) -> Floats:
    """1/σ of each output; from the residuals of each output's own fit, which no other output's noise can spoil."""
    if noise is not None:
        sigma = np.asarray(noise, dtype=float)
        if (sigma <= 0).any():
            raise InputError("noise must be positive, one standard deviation for each output")
        return checked_weights(observation.layout, 1 / sigma)
    own = [
        max(count - len(columns), 1)
        for count, columns in zip(observation.counts, observation.layout.columns, strict=True)
    ]
    sigma = observation.residuals / np.sqrt(own)
    floor = 1e-9 * sigma.max() if sigma.max() > 0 else 1.0
    return 1 / np.maximum(sigma, floor)


def _estimate(
    observation: Observation,
    units: Sequence[str],
    weights: Floats,
    model: Submodel,
    history: list[dict[str, Any]],
    criterion: Criterion,
    correlation: float,
) -> Estimate:
    names, n = observation.layout.parameters, len(observation.layout.parameters)
    values, cofactor = np.zeros(n), np.zeros((n, n))
    kept = list(model.kept)
    values[kept] = model.values
    cofactor[np.ix_(kept, kept)] = model.cofactor
    diagnostics = {
        "criterion": criterion,
        "history": history,
        "eliminated": [record["parameter"] for record in history],
        "kept": [names[k] for k in kept],
        "correlation": correlation,
    }
    noise = residual_deviations(observation, values, weights, cofactor)
    outputs, counts = observation.layout.outputs, observation.counts
    return Estimate(
        f"essential ({criterion})",
        names,
        tuple(units),
        values,
        model.variance * cofactor,
        outputs,
        noise,
        counts,
        model.degrees,
        diagnostics,
    )


def _check(
    observation: Observation,
    units: Sequence[str],
    criterion: str,
    ratio: float,
    level: float,
    keep: Sequence[str],
    correlation: float,
) -> None:
    names = observation.layout.parameters
    if len(units) != len(names):
        raise InputError(f"expected {len(names)} units, one for each parameter; got {len(units)}")
    if criterion not in get_args(Criterion):
        raise InputError(f"criterion is '{criterion}'; expected one of {', '.join(get_args(Criterion))}")
    if not ratio > 1 or not 0 < level < 1 or not correlation > 0:
        raise InputError("expected a ratio above 1, a level between 0 and 1, and a positive correlation")
    strange = next((name for name in keep if name not in names), None)
    if strange is not None:
        raise InputError(f"keep has '{strange}'; it is not a parameter{nearest_of(strange, names)}")
    if observation.rows <= len(keep):
        raise InputError(f"there are only {observation.rows} rows; give more samples")
