"""Effects: forces in joints and drives that are linear in parameters of their own (friction, springs, rotor inertia).

Every effect is one parameter times a known function of the state, acting along one or more coordinates, or added to
what a sensor reads, as the zero of a force/torque sensor is.  The usual
ones are ready-made; any other is an expression.  What an effect is follows from its expression, whoever wrote it: a row
of :data:`KINDS` if it has the shape of one, and the properties of :class:`~echelon.robot.term.TermTree`.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, cached_property

from echelon.robot.term import TermTree, has_shape, read_term


class Side(StrEnum):
    """Where an effect acts, a side of a drive or a sensor; it decides which sensors see the effect."""

    JOINT = "joint"  # at the joint itself: torque sensors in the joint see it
    ACTUATOR = "actuator"  # in the drive: only the actuator's torque or current sees it
    OUTPUT = "output"  # in a measured output itself: no other one sees it


@dataclass(frozen=True)
class Action:
    """A generalised force per unit of a parameter."""

    at: str  # joint coordinate or actuator along which it acts, or output that it adds to
    side: Side  # which of these ``at`` names
    # expression of the state: ``q``, ``qd``, ``qdd`` are position, velocity and acceleration of ``at`` itself,
    # ``qd[j5]`` those of another coordinate or actuator, ``i[name]`` a measured input; symbols as in the geometry
    term: str

    @cached_property
    def read(self) -> TermTree:
        """The term as it is written for the place itself: ``qd`` for ``qd[j5]`` at j5.

        A current alone is ``i``, whichever drive it is named after.
        """
        written = read_term(self.term)
        alone = [q.name for q in written.quantities] == ["i"]
        own = [q for q in written.quantities if alone or q.at == self.at]
        return read_term(written.replaced({q.node: q.name for q in own}))

    @property
    def kind(self) -> str:
        """The kind of ready-made effect that it is; empty for others."""
        return _row_of(self.read)[0]

    @property
    def is_positive(self) -> bool:
        """Whether its parameter cannot be negative."""
        row = _row_of(self.read)[1]
        return row is not None and row.positive

    @property
    def number(self) -> JointNumber | None:
        """The number of a joint as which robot files may state its parameter."""
        row = _row_of(self.read)[1]
        return None if row is None else row.number


@dataclass(frozen=True)
class Bristles:
    """State of LuGre friction, which its terms use as input: the bristles' force by that of Coulomb friction.

    x = σ0 z/Fc obeys ẋ = stiffness (q̇ − |q̇| x/γ(q̇)) with γ = 1 + (ratio − 1) exp(−(q̇/velocity)²) (Canudas de Wit et
    al., IEEE Trans. Automatic Control 40, 1995).  All are expressions of numbers and symbols.
    """

    stiffness: str  # σ0/Fc, 1/rad or 1/m
    velocity: str  # of Stribeck, rad/s or m/s
    ratio: str  # of static to Coulomb friction


@dataclass(frozen=True)
class Effect:
    """One parameter of an effect, and what a unit of it does."""

    parameter: str  # its name, such as ``Fv1``
    unit: str  # SI unit
    actions: tuple[Action, ...]
    value: float | None = None  # value stated by the file
    bristles: Bristles | None = (
        None  # what its input is computed by, if it is not measured
    )

    @property
    def symbols(self) -> frozenset[str]:
        """Names that its terms use, geometry symbols among them."""
        terms = [action.term for action in self.actions]
        terms += [] if self.bristles is None else vars(self.bristles).values()
        return frozenset(name for term in terms for name in read_term(term).symbols)

    def with_terms(self, change: Callable[[str], str]) -> Effect:
        """The effect with other functions of the state."""
        actions = tuple(replace(a, term=change(a.term)) for a in self.actions)
        return replace(self, actions=actions)


class JointNumber(StrEnum):
    """Numbers of joints that robot files state, with their names in notes."""

    DAMPING = "viscous friction"
    DRY = "Coulomb friction"
    ARMATURE = "rotor inertia"
    STIFFNESS = "stiffness of springs"
    FORCE = "constant forces"

    def at_joint(self, ratio: float) -> float:
        """Its size at the joint by that in a drive that turns by ratio · q.

        A force acts ratio times as strongly at the joint; dry friction has the sign of the joint's velocity there; what
        is proportional to a coordinate, velocity or acceleration gets the ratio twice.
        """
        match self:
            case JointNumber.FORCE:
                return ratio
            case JointNumber.DRY:
                return abs(ratio)
        return ratio * ratio


@dataclass(frozen=True)
class EffectTerm:
    """One parameter of a ready-made effect: its symbol, its unit for a turning coordinate and the function."""

    symbol: str
    torque_unit: str
    force_unit: str
    term: str
    positive: bool = False  # whether the parameter cannot be negative: it takes energy away, or stores it
    number: JointNumber | None = None  # what robot files call it, if they can state it


KINDS: dict[str, tuple[EffectTerm, ...]] = {
    "viscous": (
        EffectTerm(
            "Fv", "N·m·s/rad", "N·s/m", "qd", positive=True, number=JointNumber.DAMPING
        ),
    ),
    "coulomb": (
        EffectTerm("Fc", "N·m", "N", "sign(qd)", positive=True, number=JointNumber.DRY),
    ),
    "smooth_coulomb": (
        EffectTerm(
            "Fc",
            "N·m",
            "N",
            "tanh(qd/({width}))",
            positive=True,
            number=JointNumber.DRY,
        ),
    ),
    "asymmetric_viscous": (
        EffectTerm("Fvp", "N·m·s/rad", "N·s/m", "(1 + sign(qd))/2*qd", positive=True),
        EffectTerm("Fvn", "N·m·s/rad", "N·s/m", "(1 - sign(qd))/2*qd", positive=True),
    ),
    "asymmetric_coulomb": (
        EffectTerm("Fcp", "N·m", "N", "(1 + sign(qd))/2", positive=True),
        EffectTerm("Fcn", "N·m", "N", "(sign(qd) - 1)/2", positive=True),
    ),
    "offset": (EffectTerm("Fo", "N·m", "N", "1", number=JointNumber.FORCE),),
    "stribeck": (
        EffectTerm(
            "Fs", "N·m", "N", "sign(qd)*exp(-(abs(qd)/({velocity}))**({exponent}))"
        ),
    ),
    "lugre": (
        EffectTerm("Fc", "N·m", "N", "i"),
        EffectTerm(
            "Fb",
            "N·m·s/rad",
            "N·s/m",
            "qd - abs(qd)*i/(1 + (({ratio}) - 1)*exp(-(qd/({velocity}))**2))",
            positive=True,
        ),
    ),
    "load_friction": (EffectTerm("Fl", "", "", "sign(qd)*abs(i)", positive=True),),
    "temperature_friction": (
        EffectTerm("FvT", "N·m·s/(rad·K)", "N·s/(m·K)", "i*qd"),
        EffectTerm("FcT", "N·m/K", "N/K", "i*sign(qd)"),
    ),
    "rotor_inertia": (
        EffectTerm(
            "Ia", "kg·m²", "kg", "qdd", positive=True, number=JointNumber.ARMATURE
        ),
    ),
    "spring": (
        EffectTerm(
            "Ks", "N·m/rad", "N/m", "q", positive=True, number=JointNumber.STIFFNESS
        ),
        EffectTerm("Ps", "N·m", "N", "1"),
    ),
    "elastic": (
        EffectTerm("Ks", "N·m/rad", "N/m", "q", positive=True),
        EffectTerm("Ds", "N·m·s/rad", "N·s/m", "qd", positive=True),
        EffectTerm("Ps", "N·m", "N", "1"),
    ),
    "counterbalance": (EffectTerm("Kb", "N·m", "N", "sin(q + ({phase}))"),),
    "cable": (
        EffectTerm("Kc", "N·m/rad", "N/m", "q"),
        EffectTerm("Kcc", "N·m/rad²", "N/m²", "q**2"),
        EffectTerm("Kccc", "N·m/rad³", "N/m³", "q**3"),
    ),
    "stop": (
        EffectTerm(
            "Kx", "N·m/rad", "N/m", "max(q - ({upper}), 0) + min(q - ({lower}), 0)"
        ),
    ),
    "ripple": (
        EffectTerm("Rs{harmonic}_", "N·m", "N", "sin(({harmonic})*q)"),
        EffectTerm("Rc{harmonic}_", "N·m", "N", "cos(({harmonic})*q)"),
    ),
    "drive_gain": (EffectTerm("Kt", "N·m/A", "N/A", "-i"),),
    "servo": (EffectTerm("Kp", "N·m/rad", "N/m", "q - i"),),
}
"""Ready-made effects; a spring has a stiffness and a preload, an elastic one damping as well.  With positive parameters
friction opposes the motion.

The input of a servo is the position that it is commanded to, and Kp its gain.
"""

CONSTANTS: dict[str, dict[str, str | None]] = {
    "smooth_coulomb": {"width": None},
    "stribeck": {"velocity": None, "exponent": "2"},
    "lugre": {"stiffness": None, "velocity": None, "ratio": "1"},
    "counterbalance": {"phase": None},
    "stop": {"lower": None, "upper": None},
    "ripple": {"harmonic": None},
}
"""Constants that a ready-made effect needs, with defaults."""

POSITIVE_CONSTANTS = ("width", "velocity", "exponent", "stiffness", "ratio")
"""Constants that are positive: speeds that a law divides by, and powers of them; what bristles have."""


def ready_made(
    kind: str,
    at: str,
    side: Side,
    label: str,
    *,
    sliding: bool,
    constants: dict[str, str] | None = None,
) -> tuple[Effect, ...]:
    """The parameters of a ready-made effect at one coordinate."""
    stated = constants or {}
    bristles = Bristles(**stated) if kind == "lugre" else None
    return tuple(
        Effect(
            f"{entry.symbol.format(**stated)}{label}",
            entry.force_unit if sliding else entry.torque_unit,
            (Action(at, side, entry.term.format(**stated)),),
            bristles=bristles,
        )
        for entry in KINDS[kind]
    )


@cache
def _templates() -> list[tuple[str, EffectTerm, ast.expr]]:
    found = []
    for kind, entries in KINDS.items():
        constants = {name: name for name in CONSTANTS.get(kind, {})}
        found += [
            (kind, entry, read_term(entry.term.format(**constants)).tree)
            for entry in entries
        ]
    return found


def _row_of(term: TermTree) -> tuple[str, EffectTerm | None]:
    """The first row of the table whose shape a term has, and its kind."""
    for kind, entry, template in _templates():
        if has_shape(template, term.tree, CONSTANTS.get(kind, {})):
            return kind, entry
    return "", None
