"""Numbers from a base model: regressors, outputs and their parts over batches of states, and observations from logs.

Each function is recorded once and runs as machine code; observation matrices are never formed.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.algebra import Function
from echelon.base.low_pass import low_pass
from echelon.base.matrix import BaseMatrix
from echelon.dynamics import ALL_FUNCTIONS, geometry_values, robot_function
from echelon.robot import Mechanism, refuse_contacts
from echelon.shared import Floats, InputError, extra, public

if TYPE_CHECKING:
    from echelon.compute import (
        NormalEquations,
        Observation,
        Observer,
        TensorFunction,
        TensorFunctions,
        TensorLibrary,
    )
    from echelon.dynamics import ClosedStates, Evaluator, Values

Log = Mapping[str, Any]
"""``q``, ``qd``, ``qdd`` and ``y``, and ``inputs`` where effects use measured inputs."""


Symbols = Mapping[str, float] | None
Inputs = Mapping[str, npt.ArrayLike] | None


@public
class Evaluation(ABC):
    """Functions of a base model at states, and observations from logs.

    Attributes
    ----------
    mechanism : Mechanism
    matrix : BaseMatrix
        Exact sparse B.

    Notes
    -----
    One state in gives one state out: arrays without the axis N, such as q of shape (positions,), give a result without
    it, such as a regressor of shape (outputs, base parameters).  The arguments are the same everywhere:

    q : array of shape (N, positions) or (positions,)
        In the order of ``mechanism.positions``, rad, m or unit quaternions (w, x, y, z).
    qd, qdd : arrays of shape (N, velocities) or (velocities,)
        In the order of ``mechanism.velocities``, rad/s, m/s, rad/s², m/s².  With loops, each of q, qd and qdd may also
        be that of the independent coordinates only, in the order of ``mechanism.independent_velocities``; the others
        then follow from the pose in which the mechanism is assembled.
    values : array of shape (r,)
        Base parameters, SI units.
    symbols : mapping of str to float, optional
        Values of geometry symbols that replace or complete those of the file.
    inputs : mapping of str to array of shape (N,) or float, optional
        Measured inputs that effects use, such as currents, by coordinate or actuator.
    out : array, optional
        Where to write; C-contiguous float64 of the result's shape.  Worth reusing for large results.
    threads : int, optional
        Largest number of threads; all processors if omitted.  The result does not depend on it.

    They raise InputError if shapes do not fit, values are missing, or ``out`` cannot be written to.  With loops, also
    if states are not closed or cannot be closed, or an output is not determined by the motion.
    """

    mechanism: Mechanism
    matrix: BaseMatrix

    @cached_property
    def _functions(self) -> dict[str, Function]:
        return {}

    def function(self, name: str) -> Function:
        """One of the model's functions in terms of base parameters, recorded when it is first asked for.

        Parameters
        ----------
        name : str
            Of :data:`echelon.dynamics.functions.ALL_FUNCTIONS`.

        Returns
        -------
        Function

        Raises
        ------
        InputError
            If there is no such function, or it is one of mechanisms with loops and there are none.
        """
        if name not in self._functions:
            self._functions[name] = robot_function(
                name, self.mechanism, self.matrix.pivots
            )
        return self._functions[name]

    def evaluate(
        self,
        name: str,
        state: Mapping[str, npt.ArrayLike],
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """Any of the model's functions, by its name, in machine code.

        Parameters
        ----------
        name : str
            See :meth:`function`; ``function(name).arguments`` lists the needed entries of the state.
        state : mapping of str to array
            ``q``, ``qd``, ``qdd``; reference velocities ``qdr`` and accelerations ``qddr``, with loops the independent
            ones; outputs ``y``; and ``parameters``, the values of base parameters; SI units.
        symbols, inputs, out, threads
            See :class:`Evaluation`.

        Returns
        -------
        array of shape (N, *function(name).shape), or function(name).shape for one state

        Raises
        ------
        InputError
            If there is no such function, or an array is missing or does not fit.

        Examples
        --------
        >>> import echelon as ec
        >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
        >>> state = {"q": [0.3, 0.5], "qd": [1.0, 2.0], "qdr": [1.1, 1.9], "qddr": [0.5, 0.1]}
        >>> Y = base.evaluate("slotine_li_regressor", state)
        >>> zeta = [0.4, 0.3, 0.1, 0.2, 0.1, 0.05]
        >>> bool(abs(Y @ zeta - base.evaluate("slotine_li", {**state, "parameters": zeta})).max() < 1e-12)
        True
        """
        return self._evaluator(name)(state, symbols, inputs, out, threads)

    # -- regressors ----------------------------------------------------------------------------------------------

    def regressor(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """The base regressor X̄, with y = X̄ ζ̄; see :class:`Evaluation` for the arguments.

        Returns
        -------
        array of shape (N, outputs, base parameters), or (outputs, base parameters) for one state
        """
        return self._evaluator("regressor")(
            {"q": q, "qd": qd, "qdd": qdd}, symbols, inputs, out, threads
        )

    def regressor_entries(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """The entries of X̄ that are not structurally zero; :attr:`sparsity` has their rows and columns.

        Arguments are those of :class:`Evaluation`.

        Returns
        -------
        array of shape (N, entries), or (entries,) for one state
        """
        return self._evaluator("entries")(
            {"q": q, "qd": qd, "qdd": qdd}, symbols, inputs, out, threads
        )

    @property
    def sparsity(self) -> npt.NDArray[np.intp]:
        """Output and base parameter of every entry of :meth:`regressor_entries`, shape (2, entries)."""
        entries = list(self._evaluator("entries").function.entries)
        return np.array(entries, dtype=np.intp).reshape(-1, 2).T

    def standard_regressor(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """The regressor X of all standard parameters, with y = X ζ; see :class:`Evaluation` for the arguments.

        Returns
        -------
        array of shape (N, outputs, standard parameters), or (outputs, standard parameters) for one state
        """
        return self._evaluator("standard_regressor")(
            {"q": q, "qd": qd, "qdd": qdd}, symbols, inputs, out, threads
        )

    def filtered_regressor(
        self,
        times: npt.ArrayLike,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        bandwidth: float,
        symbols: Symbols = None,
        inputs: Inputs = None,
    ) -> Floats:
        """X̄ along a motion behind λ/(s + λ), without accelerations: λ (P − P filtered) and the bias filtered.

        P is the regressor of the momentum, and the bias that of the outputs less the momentum's rate.  Filtered outputs
        that belong to it are ``low_pass(times, y, bandwidth)``.

        Parameters
        ----------
        times : array of shape (N,)
            Increasing, s.
        q, qd, symbols, inputs
            See :class:`Evaluation`.
        bandwidth : float
            λ, rad/s.

        Returns
        -------
        array of shape (N, outputs, base parameters)

        Raises
        ------
        InputError
            See :func:`low_pass`.

        Examples
        --------
        >>> import numpy as np
        >>> import echelon as ec
        >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
        >>> t = np.linspace(0, 2, 2001)[:, None]
        >>> q, qd, qdd = (f(3*t + [0, 1]) * 3**k for k, f in enumerate([np.sin, np.cos, lambda x: -np.sin(x)]))
        >>> X = ec.low_pass(t[:, 0], base.regressor(q, qd, qdd), 10.0)
        >>> bool(abs(base.filtered_regressor(t[:, 0], q, qd, 10.0) - X).max() < 1e-4)
        True
        """
        state = {"q": np.atleast_2d(q), "qd": np.atleast_2d(qd)}
        momenta = self.evaluate("momentum_regressor", state, symbols)
        bias = self.evaluate("momentum_bias_regressor", state, symbols, inputs)
        started = momenta[0] if len(momenta) else 0.0
        rest = momenta - low_pass(times, momenta, bandwidth, started)
        found: Floats = bandwidth * rest + low_pass(times, bias, bandwidth)
        return found

    # -- outputs -------------------------------------------------------------------------------------------------

    def predict(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        values: npt.ArrayLike,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """The outputs y = X̄ ζ̄, by a Newton–Euler recursion in the base parameters alone.

        Arguments are those of :class:`Evaluation`.

        Returns
        -------
        array of shape (N, outputs), or (outputs,) for one state
        """
        state = {"q": q, "qd": qd, "qdd": qdd, "parameters": values}
        return self._evaluator("inverse_dynamics")(state, symbols, inputs, out, threads)

    def gravity(
        self,
        q: npt.ArrayLike,
        values: npt.ArrayLike,
        symbols: Symbols = None,
        *,
        threads: int | None = None,
    ) -> Floats:
        """Outputs that hold the bodies' weight at rest, shape (N, outputs) or (outputs,); see :class:`Evaluation`."""
        return self._evaluator("gravity")(
            {"q": q, "parameters": values}, symbols, None, None, threads
        )

    def coriolis(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        values: npt.ArrayLike,
        symbols: Symbols = None,
        *,
        threads: int | None = None,
    ) -> Floats:
        """The Coriolis and centrifugal outputs C(q, q̇) q̇, shape (N, outputs) or (outputs,); see :class:`Evaluation`."""
        return self._evaluator("coriolis")(
            {"q": q, "qd": qd, "parameters": values}, symbols, None, None, threads
        )

    def effects(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        values: npt.ArrayLike,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        threads: int | None = None,
    ) -> Floats:
        """The outputs of friction, springs and other effects at zero accelerations, shape (N, outputs) or (outputs,).

        Arguments are those of :class:`Evaluation`.
        """
        return self._evaluator("effects")(
            {"q": q, "qd": qd, "parameters": values}, symbols, inputs, None, threads
        )

    def mass_matrix(
        self,
        q: npt.ArrayLike,
        values: npt.ArrayLike,
        symbols: Symbols = None,
        *,
        threads: int | None = None,
    ) -> Floats:
        """The mass matrix ∂y/∂q̈, shape (N, outputs, independent velocities), without N for one state.

        The outputs are ``mass_matrix · q̈ + coriolis + gravity + effects``.  Arguments are those of :class:`Evaluation`.
        """
        return self._evaluator("mass_matrix")(
            {"q": q, "parameters": values}, symbols, None, None, threads
        )

    def inverse_dynamics_derivatives(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        values: npt.ArrayLike,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        threads: int | None = None,
    ) -> tuple[Floats, Floats]:
        """Derivatives of the outputs; see :class:`Evaluation` for the arguments.

        Returns
        -------
        by_position : array of shape (N, outputs, positions), or (outputs, positions) for one state
            Those of a unit quaternion's entries are along the unit sphere.  With loops, one for every independent
            velocity coordinate: of turns about a ball's own axes, while all dependent coordinates follow.
        by_velocity : array of shape (N, outputs, independent velocities), or (outputs, independent velocities)
        """
        state = {"q": q, "qd": qd, "qdd": qdd, "parameters": values}
        both = self._evaluator("inverse_dynamics_derivatives")(
            state, symbols, inputs, None, threads
        )
        positions = both.shape[-1] - self.mechanism.degrees_of_freedom
        return both[..., :positions], both[..., positions:]

    def without_contact_forces(
        self,
        q: npt.ArrayLike,
        touching: npt.ArrayLike | None = None,
        noise: npt.ArrayLike | None = None,
        symbols: Symbols = None,
        unknown: npt.ArrayLike | None = None,
    ) -> Floats:
        """Matrices T by which unknown contact forces leave y = X̄ ζ̄ - Jᵀ λ: T y = T X̄ ζ̄.

        T is the projector along the columns of Jᵀ that is orthogonal after division by the noise, so that least squares
        with T X̄ and T y are those of all unknowns, contact forces included (Golub and Van Loan, Matrix Computations,
        section 6.2).  J is ``function("contact_jacobian")``.

        Parameters
        ----------
        q : array of shape (N, positions), or (positions,) for one state
        touching : array of bool of shape (N, contacts) or (contacts,), optional
            Which contacts of ``mechanism.contacts`` touch at which state; all of them if omitted.
        noise : array of shape (outputs,), optional
            Standard deviations of the outputs, by which rows are divided; 1 if omitted.
        symbols : mapping of str to float, optional
        unknown : array of bool of shape (N, outputs), optional
            Outputs that are not known at a state, such as torques of joints with dry friction at rest; T takes them off
            as it does forces at contacts.

        Returns
        -------
        array of shape (N, outputs, outputs), or (outputs, outputs) for one state

        Raises
        ------
        InputError
            If the mechanism has no contacts, or a shape does not fit.
        """
        contacts = self.mechanism.contacts
        jacobians = self._evaluator("contact_jacobian")({"q": q}, symbols)
        slips = np.array(jacobians, ndmin=3)
        deviations = np.ones(slips.shape[2]) if noise is None else np.asarray(noise)
        touch = (
            np.ones((len(slips), len(contacts)), dtype=bool)
            if touching is None
            else np.array(touching, dtype=bool, ndmin=2)
        )
        if touch.shape != (len(slips), len(contacts)):
            names = ", ".join(contact.name for contact in contacts)
            raise InputError(
                f"touching has shape {touch.shape}; expected ({len(slips)}, {len(contacts)}): {names}"
            )
        if deviations.shape != slips.shape[2:] or not np.all(deviations > 0):
            raise InputError(
                f"noise is {deviations.shape[0] if deviations.ndim else 1} numbers; expected {slips.shape[2]}, above zero"
            )
        rows = [len(contact.kind.components) for contact in contacts]
        forces = slips / deviations * np.repeat(touch, rows, axis=1)[:, :, None]
        measured = [
            component in contact.measured
            for contact in contacts
            for component in contact.kind.components
        ]
        forces[:, measured] = 0.0
        if unknown is not None and np.any(unknown):
            alone = (
                np.eye(len(deviations)) * np.asarray(unknown, dtype=bool)[:, :, None]
            )
            forces = np.concatenate([forces, alone], axis=1)
        projectors = np.eye(len(deviations)) - np.linalg.pinv(forces) @ forces
        found: Floats = projectors / deviations
        return found[0] if np.ndim(q) == 1 else found

    def constraint_forces(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        standard: npt.ArrayLike,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        threads: int | None = None,
    ) -> Floats:
        """Moments and forces that closures exert on their second bodies, those that rigid bodies determine.

        They are about the origin of the closure's first frame and in its axes.  ``function("constraint_forces")`` names
        them in ``axes[0]``, and in ``meaning`` those that redundant constraints leave undetermined.

        Parameters
        ----------
        q, qd, qdd, symbols, inputs, threads
            See :class:`Evaluation`.
        standard : array of shape (standard parameters,)
            SI units.  Base parameters determine outputs, but not the forces inside of loops.

        Returns
        -------
        array of shape (N, components), or (components,) for one state

        Raises
        ------
        InputError
            If there are no loops, or none of the components is determined.
        """
        state = {"q": q, "qd": qd, "qdd": qdd, "standard_parameters": standard}
        return self._evaluator("constraint_forces")(
            state, symbols, inputs, None, threads
        )

    # -- arrays of other libraries ---------------------------------------------------------------------------------

    def to_jax(self, symbols: Symbols = None) -> TensorFunctions:
        """The functions of :meth:`function` on arrays of JAX: pure, for ``jit``, ``vmap`` and ``grad``.

        Parameters
        ----------
        symbols : mapping of str to float, optional
            Values of geometry symbols that replace or complete those of the file.  The argument ``symbols`` of a
            function takes an array instead, for derivatives by the geometry.

        Returns
        -------
        TensorFunctions
            Each function is an attribute.  Its arguments, in the order of ``attribute.function.arguments``, have shape
            (..., size) with any leading axes; base parameters and geometry may have leading axes, too.  Results keep
            the type of the arguments and their device; JAX has double precision where ``jax_enable_x64`` is set.
            With loops, ``q`` holds all positions, which must be closed, and rates are independent.

        Raises
        ------
        MissingExtraError
            If JAX is not installed.

        Examples
        --------
        >>> import echelon as ec
        >>> import jax
        >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
        >>> dynamics = base.to_jax()
        >>> q, values = jax.numpy.zeros((5, 2)), jax.numpy.ones(6)
        >>> dynamics.gravity(q, values).shape
        (5, 2)
        >>> jax.jacobian(dynamics.gravity)(q[0], values).shape
        (2, 2)
        """
        with extra("jax"):
            import jax.numpy  # noqa: F401
        from echelon.compute import TensorLibrary

        return self._tensors(TensorLibrary("jax.numpy", "asarray"), symbols)

    def to_torch(self, symbols: Symbols = None) -> TensorFunctions:
        """The functions of :meth:`function` on tensors of PyTorch, with gradients, on the tensors' device.

        Parameters
        ----------
        symbols : mapping of str to float, optional
            As for :meth:`to_jax`.

        Returns
        -------
        TensorFunctions
            As for :meth:`to_jax`.

        Raises
        ------
        MissingExtraError
            If PyTorch is not installed.
        """
        with extra("torch"):
            import torch  # noqa: F401
        from echelon.compute import TensorLibrary

        return self._tensors(TensorLibrary("torch", "as_tensor"), symbols)

    def _tensors(self, library: TensorLibrary, symbols: Symbols) -> TensorFunctions:
        from echelon.compute import TensorFunctions

        make = partial(self._tensor_function, library, symbols)
        return TensorFunctions(make, ("standard_regressor", *ALL_FUNCTIONS))

    def _tensor_function(
        self, library: TensorLibrary, symbols: Symbols, name: str
    ) -> TensorFunction:
        from echelon.compute import TensorFunction

        function = self._recorded(name)
        stated = geometry_values(self.mechanism, function.arguments, symbols)
        numbers = {name: values.tolist() for name, values in stated.items()}
        return TensorFunction(function, library, numbers)

    # -- machine code --------------------------------------------------------------------------------------------

    @cached_property
    def _loops(self) -> ClosedStates | None:
        """The completion of states by their dependent coordinates; None without any."""
        if not self.mechanism.dependent_velocities:
            return None
        from echelon.dynamics import ClosedStates

        return ClosedStates(self.mechanism)

    @cached_property
    def _evaluators(self) -> dict[str, Evaluator]:
        return {}

    def _evaluator(self, name: str) -> Evaluator:
        """Machine code of a function, compiled when it is first asked for."""
        if name not in self._evaluators:
            from echelon.dynamics import Evaluator

            self._evaluators[name] = Evaluator(
                self.mechanism,
                self._recorded(name),
                sparse=name == "entries",
                loops=self._loops,
            )
        return self._evaluators[name]

    def _recorded(self, name: str) -> Function:
        if name == "standard_regressor":
            return robot_function(
                "regressor", self.mechanism, range(len(self.mechanism.parameters))
            )
        return self.function("regressor" if name == "entries" else name)

    # -- logs ----------------------------------------------------------------------------------------------------

    def accumulate(
        self,
        log: Log | Iterable[Log],
        symbols: Mapping[str, float] | None = None,
        *,
        block: int | None = None,
        threads: int | None = None,
    ) -> Observation:
        """R-factors of the observation matrix W and the measured outputs y, without building W.

        The regressor is generated block by block inside a Householder QR factorisation, in constant memory.

        Parameters
        ----------
        log : mapping of str to array, or iterable of such
            ``q``, ``qd``, ``qdd`` as for a regressor, ``y`` of shape (N, outputs), and ``inputs``, a mapping, where
            effects use measured inputs.  Pieces of an iterable follow one another; how a log is cut into pieces does
            not change the result.
        symbols : mapping of str to float, optional
        block : int, optional
            Samples that are factored together.
        threads : int, optional
            The result does not depend on it.

        Returns
        -------
        Observation
            One factor per output; they can be merged with those of other logs, weighted and solved.

        Raises
        ------
        InputError
            If arrays do not fit, or values are missing or not finite.
        """
        return self._observer(self._values(log, symbols), block=block, threads=threads)

    def normal_equations(
        self,
        log: Log | Iterable[Log],
        symbols: Mapping[str, float] | None = None,
        *,
        block: int | None = None,
        threads: int | None = None,
    ) -> NormalEquations:
        """WᵀW and Wᵀy, without building W: faster than :meth:`accumulate`, with half the digits.

        ``log``, ``symbols``, ``block`` and ``threads`` are those of :meth:`accumulate`.

        Returns
        -------
        NormalEquations
        """
        return self._observer.normal_equations(
            self._values(log, symbols), block=block, threads=threads
        )

    @cached_property
    def _observer(self) -> Observer:
        from echelon.compute import Observer

        refuse_contacts(
            self.mechanism,
            "rows of logs hold the unknown forces at contacts: multiply them by without_contact_forces first",
        )
        return Observer(self.function("regressor"))

    def _values(
        self, log: Log | Iterable[Log], symbols: Mapping[str, float] | None
    ) -> Iterator[Values]:
        """Arguments of the regressor and measured outputs, piece by piece."""
        from echelon.dynamics import function_values

        regressor = self.function("regressor")
        for piece in [log] if isinstance(log, Mapping) else log:
            state = {name: value for name, value in piece.items() if name != "inputs"}
            yield function_values(
                self.mechanism,
                regressor,
                state,
                symbols,
                piece.get("inputs"),
                self._loops,
            )
