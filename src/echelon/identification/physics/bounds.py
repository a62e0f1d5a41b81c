"""Bounds: what a user knows of the bodies beyond that they can exist."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import inf, isnan
from typing import Any

from echelon.errors import InputError
from echelon.hints import nearest_of
from echelon.mechanism.mechanism import Mechanism

Range = tuple[float, float]
Triple = tuple[float, float, float]

SYMMETRIES = ("yz", "xz", "xy", "x", "y", "z")
"""Planes and axes of symmetry, through the origin of the body's frame."""


@dataclass(frozen=True)
class BodyBounds:
    """What is known of one body; all about and along its own frame, SI units.

    Attributes
    ----------
    mass : (least, largest), optional
        kg; equal numbers fix it.
    box : (corner, opposite corner), optional
        Box that holds the centre of mass, m.
    ellipsoid : (centre, semi-axes), optional
        Ellipsoid along the frame's axes that holds the centre of mass, m.
    extent : (centre, semi-axes), optional
        Ellipsoid along the frame's axes that holds all of the mass, m.
    symmetry : tuple of str
        Planes (``"xy"``, ``"xz"``, ``"yz"``) to which the distribution of mass is symmetric, and axes (``"x"``,
        ``"y"``, ``"z"``) about which it is; through the origin of the frame.
    """

    mass: Range | None = None
    box: tuple[Triple, Triple] | None = None
    ellipsoid: tuple[Triple, Triple] | None = None
    extent: tuple[Triple, Triple] | None = None
    symmetry: tuple[str, ...] = ()


@dataclass(frozen=True)
class Bounds:
    """Bounds of a robot's standard parameters.

    Made from plain mappings by :meth:`of`.

    Attributes
    ----------
    bodies : mapping of str to BodyBounds
        By body name.
    parameters : mapping of str to (least, largest)
        By parameter name, SI units; they replace the sign that friction, rotor inertia and stiffness have by default.
    total_mass : (least, largest), optional
        Of all bodies, kg.
    margin : float
        Each body's pseudo-inertia is at least this multiple of its prior's or of its scale.
    """

    bodies: Mapping[str, BodyBounds] = field(default_factory=dict)
    parameters: Mapping[str, Range] = field(default_factory=dict)
    total_mass: Range | None = None
    margin: float = 0.0

    @staticmethod
    def of(mechanism: Mechanism, given: Mapping[str, Any], source: str | None = None) -> Bounds:
        """Bounds from plain mappings, as a YAML file gives them.

        Parameters
        ----------
        mechanism : Mechanism
        given : mapping
            Keys ``bodies``, ``parameters``, ``total_mass``, ``margin``; a body has ``mass``, ``box``, ``ellipsoid``,
            ``extent``, ``symmetry``.  Infinite or missing (None) ends of a range leave it open.
        source : str, optional
            File, for messages.

        Raises
        ------
        InputError
            If a body, a parameter or a key is unknown (names near ones), or a range is none.

        Examples
        --------
        >>> import echelon as ec
        >>> arm = ec.load("examples/double_pendulum.yaml")
        >>> Bounds.of(arm, {"bodies": {"j1": {"mass": [0.1, 2], "symmetry": "xy"}}}).bodies["j1"].mass
        (0.1, 2.0)
        """
        try:
            return _read(mechanism, given)
        except InputError as error:
            raise error.located(source) if source else error from None

    def check(self, mechanism: Mechanism) -> None:
        """Check that bodies and parameters exist and carry what is bounded.

        Raises
        ------
        InputError
            If not.
        """
        carried = {body.name: body.carried for body in mechanism.bodies}
        for name, body in self.bodies.items():
            where = f"bounds of body '{name}'"
            if name not in carried:
                raise InputError(f"there is no such body{nearest_of(name, carried)}", element=where)
            if (body.box or body.ellipsoid or body.extent or body.symmetry) and len(carried[name]) < 10:
                raise InputError("it does not carry all ten parameters, so it has no centre of mass", element=where)
            if body.mass and 9 not in carried[name]:
                raise InputError("its mass is not among its parameters", element=where)
        for name in self.parameters:
            if name not in mechanism.parameters:
                raise InputError(
                    f"there is no such parameter{nearest_of(name, mechanism.parameters)}", element=f"bounds of '{name}'"
                )


def _read(mechanism: Mechanism, given: Mapping[str, Any]) -> Bounds:
    _check_keys(given, ("bodies", "parameters", "total_mass", "margin"), "bounds")
    bodies = {str(name): _body(str(name), value) for name, value in (given.get("bodies") or {}).items()}
    parameters = {
        str(name): _range(value, f"bounds of '{name}'") for name, value in (given.get("parameters") or {}).items()
    }
    total = given.get("total_mass")
    margin = given.get("margin", 0.0)
    if isinstance(margin, bool) or not isinstance(margin, int | float) or not 0 <= margin < 1:
        raise InputError(f"expected a number from 0 to below 1, got {margin!r}", element="bounds: margin")
    mass = None if total is None else _range(total, "bounds: total_mass", least=0.0)
    bounds = Bounds(bodies, parameters, mass, float(margin))
    bounds.check(mechanism)
    return bounds


def _body(name: str, given: Any) -> BodyBounds:
    where = f"bounds of body '{name}'"
    _check_keys(given, ("mass", "box", "ellipsoid", "extent", "symmetry"), where)
    box, ellipsoid, extent = (
        _pair(given[key], where, key) if key in given else None for key in ("box", "ellipsoid", "extent")
    )
    if box and any(low > high for low, high in zip(*box, strict=True)):
        raise InputError("the first corner of the box must not exceed the second", element=where)
    for shape in (ellipsoid, extent):
        if shape and min(shape[1]) <= 0:
            raise InputError("the semi-axes of the ellipsoid must be positive", element=where)
    symmetry = given.get("symmetry", ())
    planes = (symmetry,) if isinstance(symmetry, str) else tuple(symmetry)
    for plane in planes:
        if plane not in SYMMETRIES:
            valid = f"planes {', '.join(SYMMETRIES[:3])}; axes {', '.join(SYMMETRIES[3:])}"
            raise InputError(f"unknown symmetry {plane!r} (valid: {valid})", element=where)
    mass = _range(given["mass"], f"{where}: mass", least=0.0) if "mass" in given else None
    return BodyBounds(mass, box, ellipsoid, extent, planes)


def _range(value: Any, where: str, least: float = -inf) -> Range:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise InputError(f"expected two numbers [least, largest], got {value!r}", element=where)
    ends = (-inf if value[0] is None else value[0], inf if value[1] is None else value[1])
    if any(isinstance(x, bool) or not isinstance(x, int | float) or isnan(x) for x in ends):
        raise InputError(f"expected two numbers [least, largest], got {value!r}", element=where)
    low, high = max(float(ends[0]), least), float(ends[1])
    if low > high or low == inf or high == -inf:
        raise InputError(f"nothing is between {value[0]!r} and {value[1]!r}", element=where)
    return (low, high)


def _pair(value: Any, where: str, key: str) -> tuple[Triple, Triple]:
    wrong = InputError(f"{key}: expected two times three numbers [[x, y, z], [x, y, z]], got {value!r}", element=where)
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise wrong
    triples = []
    for part in value:
        if not isinstance(part, list | tuple) or len(part) != 3 or not all(map(_is_finite, part)):
            raise wrong
        triples.append((float(part[0]), float(part[1]), float(part[2])))
    return (triples[0], triples[1])


def _is_finite(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and -inf < x < inf


def _check_keys(given: Any, valid: Iterable[str], where: str) -> None:
    if not isinstance(given, Mapping):
        raise InputError(f"expected a mapping, got {given!r}", element=where)
    for key in given:
        if key not in valid:
            raise InputError(f"unknown key '{key}'{nearest_of(str(key), valid)}", element=where)
