"""The information that a motion gives about base parameters, and its derivatives by the motion's coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.excite.families.basis import Basis
from echelon.excite.pullback import StateRegressor


class Information:
    """F(C) = F₀ + Σ X̄ᵀ diag(weights) X̄ over the samples of a motion with coefficients C.

    Parameters
    ----------
    regressor : StateRegressor
    basis : Basis
    times : array of shape (N,)
        Samples, s.
    weights : array of shape (m,)
        1/σ² of each output's noise.
    prior : array of shape (r, r)
        Information that is there already.

    Notes
    -----
    X̄ of some thousand samples stays in the caches, where forming F and the derivatives by X̄ from it is cheaper than
    making it twice.  Only entries that are not structurally zero are made.
    """

    def __init__(self, regressor: StateRegressor, basis: Basis, times: Floats, weights: Floats, prior: Floats) -> None:
        self._regressor, self.weights, self.prior = regressor, weights, prior
        self._phi = tuple(np.ascontiguousarray(basis.values(times, order)) for order in range(3))
        self._rows = regressor.rows

    def __call__(self, coefficients: Floats) -> Seen:
        """The information of a motion.

        Parameters
        ----------
        coefficients : array of shape (basis.size, n)
        """
        state = {name: phi @ coefficients for name, phi in zip(("q", "qd", "qdd"), self._phi, strict=True)}
        entries = self._regressor.entries(state)
        F = self.prior.copy()
        for rows, weight in zip(self._rows, self.weights, strict=True):
            block = entries[:, rows.entries]
            F[np.ix_(rows.columns, rows.columns)] += weight * (block.T @ block)
        return Seen(self, state, entries, F)

    def _gradient(self, seen: Seen, slope: Floats) -> Floats:
        adjoint = np.empty_like(seen.entries)
        for rows, weight in zip(self._rows, self.weights, strict=True):
            part = slope[np.ix_(rows.columns, rows.columns)] * (2 * weight)
            adjoint[:, rows.entries] = seen.entries[:, rows.entries] @ part
        pulled = self._regressor.pulled(seen.state, adjoint)
        total: Floats = np.hstack([phi.T for phi in self._phi]) @ np.vstack(pulled)
        return total


@dataclass(frozen=True, eq=False)
class Seen:
    """What a motion shows.

    Attributes
    ----------
    source : Information
    state : mapping of str to array
    entries : array of shape (N, entries)
    F : array of shape (r, r)
        The information matrix.
    """

    source: Information
    state: dict[str, Floats]
    entries: Floats
    F: Floats

    def gradient(self, slope: Floats) -> Floats:
        """Derivatives of a function of F by the coefficients, shape (basis.size, n).

        Parameters
        ----------
        slope : array of shape (r, r)
            Symmetric M with dφ = tr(M dF).
        """
        return self.source._gradient(self, slope)
