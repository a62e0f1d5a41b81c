"""Estimates that follow a robot while it moves: recursive least squares in square-root form.

The state is a triangle R of [W y] for each output, to which new rows are added by orthogonal transformations: the
information form, and not the covariance P = (RᵀR)⁻¹.  Each digit of the data counts, as in the batch, while updates
of P square the condition number and lose symmetry; there is no start with a "large" P, as no information is R = 0;
rows of different noise, missing rows and batches of any length are the same step; and the estimate is that of the
batch to rounding, whatever the order.  The price is a back substitution for each estimate, not for each sample.

With forgetting λ, a sample that is k samples old counts λᵏ:

    minimise  Σ λᵏ Σ_i ((y_i − X̄_i ζ)/σ_i)² + ‖ζ − ζ₀‖²_Π

The prior does not fade.  Exponential forgetting alone lets information die out along directions that the motion does
not excite, while that along others is renewed: the covariance winds up, and noise bursts into the estimate.  With a
prior it is bounded by the prior's.

The covariance is (Σ λᵏ …)⁻¹, that of a Kalman filter for parameters that drift so fast that the information of a sample
fades by λ with each later one: intervals hold for parameters that change, and grow where nothing renews what is known.
Constant parameters are known better, by up to a factor of √2.  The noise is found from residuals as in the batch, with
effective numbers of rows and parameters; Σ λ²ᵏ / Σ λᵏ is the share of an excitation that lasts that fits to noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel, base_of
from echelon.compute import Layout, Observation, Triangle, real_array, upper_triangle
from echelon.dynamics import STATE
from echelon.identification.estimators.estimate import (
    ROUNDING,
    Estimate,
    WeightedSolution,
    solved,
)
from echelon.identification.estimators.least_squares import (
    checked_noise,
    fixed_noise,
    noise_estimate,
    noise_floor,
    used_up,
)
from echelon.identification.physics.feasibility import checked_values, information_root
from echelon.identification.physics.fit import PhysicalFit, physical_fit
from echelon.robot import Mechanism, Readable, refuse_contacts
from echelon.shared import Floats, InputError, public

Factors = tuple[Floats, ...]  # the R-factor of each output's rows of [W y]
Inputs = Mapping[str, npt.ArrayLike] | None


@public
def online(
    base: BaseModel | Mechanism | Readable,
    *,
    noise: Sequence[float] | Floats | None = None,
    forgetting: float = 1.0,
    prior: Sequence[float] | Floats | None = None,
    covariance: Sequence[float] | Floats | None = None,
) -> OnlineEstimator:
    """Recursive least squares for the base parameters of a robot, in square-root form and constant memory.

    Parameters
    ----------
    base : BaseModel, Mechanism or path-like
        A set of base parameters or its file; of a robot or its file, base parameters are derived first.
    noise : array of shape (outputs,), optional
        Standard deviation of each output's noise, in its unit.  If omitted, it is estimated from the residuals.
    forgetting : float
        λ in (0, 1]: a sample that is k samples old counts λᵏ.  With 1 nothing is forgotten.
    prior : array of shape (r,), optional
        Base parameters to start from, SI units.  The prior does not fade: where the motion excites little, the
        estimate returns to it and the covariance stays bounded, while without it the covariance grows without bound.
    covariance : array of shape (r, r) or (r,), optional
        Covariance of the prior, or its standard deviations.

    Returns
    -------
    OnlineEstimator

    Raises
    ------
    InputError
        If a value is not valid, only one of prior and covariance is given, or contacts leave forces unknown.

    Examples
    --------
    >>> import echelon as ec
    >>> import numpy as np
    >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
    >>> estimator = ec.online(base, noise=[0.1, 0.1], forgetting=0.999)
    >>> true = np.array([0.4, 0.3, 0.1, 0.2, 0.1, 0.05])
    >>> for q, qd, qdd in np.random.default_rng(0).normal(size=(500, 3, 2)):
    ...     estimator.update(q, qd, qdd, base.predict(q, qd, qdd, true))
    >>> estimator
    OnlineEstimator(500 samples, forgetting 0.999: rank 6 of 6, scaled condition 1.75)
    >>> estimator.estimate().values.round(9).tolist()
    [0.4, 0.3, 0.1, 0.2, 0.1, 0.05]
    """
    base = base_of(base)
    if not 0 < forgetting <= 1:
        raise InputError(
            f"forgetting is {forgetting}; expected a number above 0 and up to 1, such as 0.999"
        )
    refuse_contacts(
        base.mechanism,
        "outputs hold the unknown forces at contacts: estimate online without them",
    )
    if (prior is None) != (covariance is None):
        raise InputError("give both a prior and its covariance, or neither")
    known = None
    if prior is not None:
        target = checked_values(base, prior)
        matrix = real_array("covariance", np.asarray(covariance))
        if matrix.ndim == 1 and not (matrix > 0).all():
            raise InputError("the covariance has deviations that are not positive")
        square = np.diag(matrix**2) if matrix.ndim == 1 else matrix
        root = information_root(base, target, square)
        known = upper_triangle(np.column_stack([root, root @ target]))
    return OnlineEstimator(base, noise, forgetting, known)


@public
class OnlineEstimator:
    """Recursive least squares; made by :func:`echelon.online`.

    Attributes
    ----------
    base : BaseModel
    forgetting : float
    samples : int
        Samples so far.
    """

    def __init__(
        self,
        base: BaseModel,
        noise: Sequence[float] | Floats | None,
        forgetting: float,
        prior: Floats | None = None,
    ) -> None:
        """An estimator without any samples.

        Parameters
        ----------
        base : BaseModel
        noise : array of shape (outputs,), optional
        forgetting : float
        prior : array of shape (r + 1, r + 1), optional
            R-factor of the prior's rows, whitened.
        """
        function = base.function("regressor")
        rows = range(function.shape[0])
        columns = tuple(
            tuple(sorted(c for row, c in function.entries if row == k)) for k in rows
        )
        self.base, self.forgetting, self.samples = base, forgetting, 0
        self._layout = Layout(function.axes[0], function.axes[1], columns)
        self._factors: Factors = tuple(np.zeros((s, s)) for s in self._layout.sizes)
        # of each output: rows, the sum of their weights, and of the squares of these
        self._rows = np.zeros(len(rows), dtype=int)
        self._weights, self._squares = np.zeros((2, len(rows)))
        self._prior = prior
        self._noise = None if noise is None else checked_noise(self._data, noise)

    def update(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        y: npt.ArrayLike,
        inputs: Inputs = None,
        symbols: Mapping[str, float] | None = None,
    ) -> None:
        """Take in a sample, or several in the order of time.

        Parameters
        ----------
        q, qd, qdd : arrays of shape (N, size) or (size,)
            States, as for :meth:`BaseModel.regressor`.
        y : array of shape (N, outputs) or (outputs,)
            Measured outputs.  NaN where an output is missing: its row is skipped, and the others of the sample count.
        inputs : mapping of str to array of shape (N,), optional
            Measured inputs that effects use.
        symbols : mapping of str to float, optional
            Values of geometry symbols that replace or complete those of the file.

        Raises
        ------
        InputError
            If shapes do not fit, or a value is not finite; then nothing has changed.
        """
        states = zip(STATE, (q, qd, qdd), strict=True)
        q, qd, qdd = (np.atleast_2d(real_array(name, array)) for name, array in states)
        rows = self.base.regressor(q, qd, qdd, symbols, inputs)
        measured = np.atleast_2d(real_array("y", y))
        if measured.shape != rows.shape[:2]:
            raise InputError(
                f"y has shape {measured.shape}; expected {rows.shape[:2]}: {', '.join(self._layout.outputs)}"
            )
        seen = ~np.isnan(measured)
        finite = np.isfinite(rows).all(axis=(1, 2)) & ~np.isinf(measured).any(axis=1)
        if not finite.all():
            raise InputError(
                f"sample {int(finite.argmin())} has a state that is not finite, or an infinite output; leave it out"
            )
        weights: Floats = np.power(self.forgetting, np.arange(len(rows))[::-1])
        left = self.forgetting ** len(rows)
        table = np.concatenate([rows, measured[:, :, None]], axis=2)
        table[~seen] = 0.0
        scaled = np.sqrt(weights)[:, None, None] * table
        self._factors = tuple(
            upper_triangle(
                scaled[:, k, self._layout.places(k)], start=np.sqrt(left) * R
            )
            for k, R in enumerate(self._factors)
        )
        self._rows = self._rows + seen.sum(axis=0)
        self._weights = left * self._weights + weights @ seen
        self._squares = left**2 * self._squares + weights**2 @ seen
        self.samples += len(rows)

    # -- what is known so far ----------------------------------------------------------------------------------

    @property
    def triangle(self) -> Triangle:
        """R-factor of all rows, divided by the noise if it was given, and of the prior: rank, singular values, …."""
        ones = np.ones(len(self._rows))
        return self._stacked(ones if self._noise is None else self._noise)

    @property
    def rank(self) -> int:
        """Number of directions of the base parameters that the samples so far, and the prior, determine."""
        return self.triangle.rank

    @property
    def condition(self) -> float:
        """Condition number of all rows with columns scaled to norm 1: where it grows, excitation is poor."""
        return self.triangle.scaled_condition

    def estimate(self) -> Estimate:
        """The estimate from all samples so far, with its covariance and intervals.

        The covariance is that of independent noise and, with forgetting, of parameters that drift accordingly: constant
        ones are known better, by up to a factor of √2.  The prior counts as a measurement with its covariance.

        Returns
        -------
        Estimate
            ``noise`` is what the residuals show, also where noise was given.

        Raises
        ------
        InputError
            If the samples do not determine all parameters; the message names the directions that are open.
        """
        noise = self._estimated_noise() if self._noise is None else self._noise
        solution = self._solved(noise)
        n = len(solution.values)
        degrees = np.inf
        if self._noise is None:
            with np.errstate(invalid="ignore"):
                effective = np.nansum(self._weights**2 / self._squares)
            degrees = max(float(effective) - n * (self._prior is None), 1.0)
        return Estimate(
            "online",
            self._layout.parameters,
            self.base.units,
            solution.values,
            solution.inverse,
            self._layout.outputs,
            self._residual_noise(solution),
            tuple(self._rows.tolist()),
            degrees,
            {
                "forgetting": self.forgetting,
                "weights": solution.weights[: len(self._rows)].tolist(),
                "rank": solution.triangle.rank,
                "condition": solution.triangle.condition,
                "scaled_condition": solution.triangle.scaled_condition,
            },
        )

    def physical(
        self, prior: npt.ArrayLike | None = None, prior_weight: float = 1.0
    ) -> PhysicalFit:
        """The robot that can exist and explains the samples so far best: the estimate, projected where it is none.

        Parameters
        ----------
        prior : array of shape (standard parameters,), optional
            Standard parameters to be drawn to, SI units.
        prior_weight : float
            Weight of the prior, in variances of the noise.

        Returns
        -------
        PhysicalFit
        """
        noise = self._estimated_noise() if self._noise is None else self._noise
        triangle = self._stacked(noise)
        return physical_fit(self.base, triangle, prior=prior, prior_weight=prior_weight)

    # -- parts -------------------------------------------------------------------------------------------------

    @property
    def _data(self) -> Observation:
        return Observation(self._layout, self._factors, tuple(self._rows.tolist()))

    @property
    def _with_prior(self) -> Observation:
        """The rows, and the prior as those of one more output."""
        data, prior = self._data, self._prior
        if prior is None:
            return data
        every = tuple(range(self.base.rank))
        layout = replace(
            data.layout,
            outputs=(*data.layout.outputs, "prior"),
            columns=(*data.layout.columns, every),
        )
        return Observation(layout, (*data.factors, prior), (*data.counts, len(every)))

    def _stacked(self, noise: Floats) -> Triangle:
        return self._with_prior.combined(self._output_weights(noise))

    def _solved(self, noise: Floats) -> WeightedSolution:
        weights = self._output_weights(noise)
        return solved(self._with_prior, self.base.units, weights)

    def _output_weights(self, noise: Floats) -> Floats:
        """Factors of the outputs' rows, and of the prior's."""
        return np.append(1.0 / noise, np.ones(int(self._prior is not None)))

    def _residual_noise(self, solution: WeightedSolution) -> Floats:
        """Standard deviation of each output's residual, shape (m,); nan where the rows are all used up."""
        misfits = self._data.misfits(solution.values)
        with np.errstate(invalid="ignore", divide="ignore"):
            used = solution.leverages[: len(self._rows)] * self._squares / self._weights
            free = self._weights - used
            left = free > ROUNDING * self._weights
            return np.where(left, misfits / np.sqrt(free), np.nan)

    def _estimated_noise(self) -> Floats:
        """Noise of the outputs that agrees with their residuals; infinite where an output has no rows."""
        data = self._data
        floor = noise_floor(data)

        def updated(noise: Floats) -> Floats:
            found = self._residual_noise(self._solved(noise))
            spent = np.isnan(found) & (self._rows > 0)
            if spent.any():
                k = int(spent.argmax())
                raise InputError(
                    used_up(self._weights[k], "online()"),
                    element=f"output '{self._layout.outputs[k]}'",
                )
            return np.where(self._rows > 0, np.maximum(found, floor), np.inf)

        return fixed_noise(updated, noise_estimate(data))[0]

    def __repr__(self) -> str:
        triangle = self.triangle
        return (
            f"OnlineEstimator({self.samples} samples, forgetting {self.forgetting:g}: rank {triangle.rank} of "
            f"{self.base.rank}, scaled condition {triangle.scaled_condition:.3g})"
        )
