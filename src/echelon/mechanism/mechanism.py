"""The mechanism: a tree of bodies with joints, couplings between coordinates, and gravity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from echelon.conventions import PER_BODY, parameter_name
from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import Joint, Motion
from echelon.mechanism.placement import Vector
from echelon.mechanism.reading import Reading

GROUND = -1
"""Parent index of a body that hangs on the fixed world."""


@dataclass(frozen=True)
class Body:
    """One rigid body.

    Attributes
    ----------
    name : str
        Name in the file.
    label : str
        Short label that names its parameters: ``"3"`` gives XX3 … M3.
    parent : int
        Index of the parent body, or :data:`GROUND`.
    joint : Joint
        Connects the parent's frame to this body's frame.
    massless : bool
        A massless body carries no parameters.
    inertial : tuple of 10 floats, optional
        Standard parameters stated by the file, about the body's frame; None where the file is silent.
    """

    name: str
    label: str
    parent: int
    joint: Joint
    massless: bool = False
    inertial: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Coupling:
    """A dependent coordinate as a linear combination of independent ones: q = Σ ratio · q_k.

    A constant offset belongs into the geometry (a placement), not here.
    """

    coordinate: str
    terms: tuple[tuple[str, Polynomial], ...]


@dataclass(frozen=True)
class Symbol:
    """A geometry symbol.

    Attributes
    ----------
    name : str
    value : float or None
        Numeric value in SI units, if known.
    exact : str or None
        The value as exact text, where it has one (``"0.333"``, ``"sqrt(2)/10"``).
    meaning : str
        Where the symbol comes from, for people.
    """

    name: str
    value: float | None = None
    exact: str | None = None
    meaning: str = ""


@dataclass(frozen=True)
class Mechanism:
    """A tree of bodies.

    Attributes
    ----------
    name : str
    bodies : tuple of Body
        Parents before children; this is the base-to-tip order of the parameters.
    gravity : 3 of Polynomial, or None
        Gravity in the base frame, m/s²; None where there is none.
    couplings : tuple of Coupling
        Linear relations q = T θ that make coordinates depend on others.
    symbols : mapping of str to Symbol
        Geometry symbols with their values.
    reading : Reading, optional
        What was taken as exact when a file was read; absent for exact descriptions.

    Raises
    ------
    InputError
        If the parts do not fit together.
    """

    name: str
    bodies: tuple[Body, ...]
    gravity: Vector | None
    couplings: tuple[Coupling, ...] = ()
    symbols: Mapping[str, Symbol] = field(default_factory=dict)
    reading: Reading | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        _check_tree(self)
        _check_couplings(self)

    @property
    def motions(self) -> tuple[Motion, ...]:
        """All elementary motions in body order."""
        return tuple(motion for body in self.bodies for motion in body.joint.motions)

    @property
    def dependent(self) -> frozenset[str]:
        """Names of the coordinates that couplings express through others."""
        return frozenset(coupling.coordinate for coupling in self.couplings)

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of the independent position coordinates, the columns of ``q``."""
        return tuple(name for m in self.motions if m.name not in self.dependent for name in m.positions)

    @property
    def velocities(self) -> tuple[str, ...]:
        """Names of the independent velocity coordinates, the columns of ``qd`` and ``qdd`` and the outputs y."""
        return tuple(name for m in self.motions if m.name not in self.dependent for name in m.velocities)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of independent velocity coordinates."""
        return len(self.velocities)

    @property
    def carriers(self) -> tuple[int, ...]:
        """Indices of the bodies that carry parameters, in column order."""
        return tuple(i for i, body in enumerate(self.bodies) if not body.massless)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the standard parameters, in column order."""
        return tuple(parameter_name(self.bodies[b].label, k) for b in self.carriers for k in range(PER_BODY))

    def standard_values(self) -> tuple[float | None, ...]:
        """Standard parameters stated by the file, None where it is silent."""
        silent = (None,) * PER_BODY
        return tuple(v for b in self.carriers for v in (self.bodies[b].inertial or silent))

    def __str__(self) -> str:
        return f"{self.name}: {len(self.bodies)} bodies, {self.degrees_of_freedom} degrees of freedom"


def _check_tree(mechanism: Mechanism) -> None:
    labels: set[str] = set()
    coordinates: set[str] = set()
    for index, body in enumerate(mechanism.bodies):
        where = f"body '{body.name}'"
        if not GROUND <= body.parent < index:
            raise InputError("its parent must come before it", element=where)
        if body.label in labels:
            raise InputError(f"label '{body.label}' is already taken; labels must be unique", element=where)
        if body.inertial is not None and len(body.inertial) != PER_BODY:
            raise InputError(f"expected {PER_BODY} inertial values, got {len(body.inertial)}", element=where)
        labels.add(body.label)
        for motion in body.joint.motions:
            if motion.name in coordinates:
                raise InputError(f"coordinate '{motion.name}' occurs twice", element=f"joint '{body.joint.name}'")
            coordinates.add(motion.name)
    names = mechanism.parameters
    twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    if twice:
        raise InputError(f"labels such as 1 and X1 give two parameters the name '{twice[0]}'; choose other labels")


def _check_couplings(mechanism: Mechanism) -> None:
    scalar = {m.name for m in mechanism.motions if len(m.positions) == 1}
    dependent = [coupling.coordinate for coupling in mechanism.couplings]
    for coupling in mechanism.couplings:
        where = f"coupling of '{coupling.coordinate}'"
        if dependent.count(coupling.coordinate) > 1:
            raise InputError("the coordinate is coupled more than once", element=where)
        for name in (coupling.coordinate, *(name for name, _ in coupling.terms)):
            if name not in scalar:
                valid = ", ".join(sorted(scalar)) or "none"
                raise InputError(f"'{name}' is not a single coordinate (valid: {valid})", element=where)
        for name, _ in coupling.terms:
            if name in dependent:
                raise InputError(f"'{name}' is itself dependent; refer to independent ones only", element=where)
