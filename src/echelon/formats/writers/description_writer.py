"""Write any mechanism as a description, exactly: reading it back gives an equal mechanism.

Joints are written by their usual types where that says everything, and otherwise as the sequence of frames and
elementary motions that they are.  Which of the two it is, is decided by reading the short form again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from echelon.algebra import Polynomial, decimal_text, format_polynomial
from echelon.formats.bodies import BASE
from echelon.formats.description.document import GENERIC
from echelon.robot import (
    ALL,
    GROUND,
    IDENTITY,
    ORIGIN,
    Body,
    Closure,
    Contact,
    ContactKind,
    Cut,
    Effect,
    Joint,
    Mechanism,
    Motion,
    MotionKind,
    Output,
    Placement,
    Spline,
    Step,
    Symbol,
    Vector,
    setup_placements,
    setup_ratios,
)
from echelon.shared import PARAMETERS, InputError

if TYPE_CHECKING:
    from echelon.formats.description.description_builder import Joints


def expression_text(value: Polynomial) -> str:
    """An expression that reads back as the same polynomial."""
    number = value.number
    return format_polynomial(value) if number is None else decimal_text(number)


def _stated(**entries: Any) -> dict[str, Any]:
    """A mapping without the keys that are None."""
    return {key: value for key, value in entries.items() if value is not None}


def frame_data(placement: Placement) -> dict[str, Any]:
    """A frame, without what is zero."""
    xyz = [expression_text(part) for part in placement.translation]
    rotation = [[expression_text(entry) for entry in row] for row in placement.rotation]
    return _stated(
        xyz=xyz if placement.translation != ORIGIN else None,
        rotation=rotation if placement.rotation != IDENTITY else None,
    )


def _loops(mechanism: Mechanism) -> dict[str, Any]:
    """The keys that describe loops, where there are some."""
    if not mechanism.closures:
        return {}
    return _stated(
        loops=[_loop(closure, mechanism) for closure in mechanism.closures],
        independent=list(mechanism.independent) or None,
        rounding=mechanism.rounding,
        assembly={
            name: repr(float(value)) for name, value in mechanism.assembly.items()
        }
        or None,
    )


def _loop(closure: Closure, mechanism: Mechanism) -> dict[str, Any]:
    return {
        "name": closure.name,
        "joint": closure.kind.value,
        "connects": [
            _part(body, mechanism) for body in (closure.first, closure.second)
        ],
        "at": frame_data(closure.first_frame),
        "on_second": frame_data(closure.second_frame),
    }


def _part(body: int, mechanism: Mechanism) -> str | None:
    if body != GROUND:
        return mechanism.bodies[body].name
    # a body may have the base's name; null is the ground in any case
    return None if any(b.name == BASE for b in mechanism.bodies) else BASE


def _setup(mechanism: Mechanism) -> dict[str, Any]:
    """The keys ``actuators``, ``effects`` and ``outputs``, where there are any."""
    ratios = {
        a.name: {name: expression_text(ratio) for name, ratio in a.terms}
        for a in mechanism.actuators
    }
    measured = mechanism.measured
    return _stated(
        actuators={name: {"terms": terms} for name, terms in ratios.items()} or None,
        effects=[_effect(effect) for effect in mechanism.effects] or None,
        outputs=None
        if measured is None
        else [_output(output, mechanism) for output in measured],
    )


def _effect(effect: Effect) -> dict[str, Any]:
    acts = [{"at": a.at, "side": a.side.value, "term": a.term} for a in effect.actions]
    value = None if effect.value is None else repr(float(effect.value))
    bristles = None if effect.bristles is None else vars(effect.bristles)
    return _stated(
        parameter=effect.parameter,
        unit=effect.unit,
        acts=acts,
        value=value,
        bristles=bristles,
    )


def _contact(contact: Contact, mechanism: Mechanism) -> dict[str, Any]:
    return _stated(
        name=contact.name,
        type=contact.kind.value,
        body=mechanism.bodies[contact.body].name,
        at=frame_data(contact.frame),
        radius=expression_text(contact.radius)
        if contact.kind is ContactKind.ROLLING
        else None,
        measured=list(contact.measured) or None,
    )


def _output(output: Output, mechanism: Mechanism) -> dict[str, Any]:
    weights = [weight for _, weight in (*output.forces, *output.cuts)]
    if weights == [1] and output.forces:
        force, _ = output.forces[0]
        return {force.side.value: force.at, "name": output.name}
    if weights == [1]:
        cut, _ = output.cuts[0]
        if output.name.endswith(f".{cut.component}"):
            name = output.name.removesuffix(f".{cut.component}")
            return {
                "name": name,
                **_wrench(cut, mechanism),
                "components": [cut.component],
            }
    terms: list[dict[str, Any]] = []
    for force, weight in output.forces:
        terms.append({force.side.value: force.at, "weight": expression_text(weight)})
    for cut, weight in output.cuts:
        terms.append(
            {
                **_wrench(cut, mechanism),
                "component": cut.component,
                "weight": expression_text(weight),
            }
        )
    reads = output.reads or None
    return _stated(name=output.name, unit=output.unit, sum=terms, reads=reads)


def _wrench(cut: Cut, mechanism: Mechanism) -> dict[str, Any]:
    return {
        "wrench": BASE if cut.body == GROUND else mechanism.bodies[cut.body].name,
        "frame": frame_data(cut.frame),
        "fixed_to": "parent" if cut.on_parent else "body",
    }


_TYPES = (
    *("revolute", "continuous", "prismatic", "cylindrical", "planar"),
    *("helical", "universal", "spherical", "floating", "fixed"),
)


def write_description(
    mechanism: Mechanism, *, elementary: bool = False
) -> dict[str, Any]:
    """A mechanism in the description format, as data for JSON or YAML."""
    names = [body.name for body in mechanism.bodies]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                "two bodies have this name; a description needs unique names",
                element=f"body '{name}'",
            )
    joints = None if elementary else _reader(mechanism)
    terms = {
        c.coordinate: {name: _function(function) for name, function in c.terms}
        for c in mechanism.couplings
    }
    return _stated(
        echelon=1,
        name=mechanism.name,
        symbols=_symbols(mechanism) or None,
        gravity=_gravity(mechanism.gravity),
        couplings=[
            {coordinate: {"terms": functions}}
            for coordinate, functions in terms.items()
        ]
        or None,
        **_loops(mechanism),
        **_setup(mechanism),
        contacts=[_contact(c, mechanism) for c in mechanism.contacts] or None,
        experiments=list(mechanism.experiments) or None,
        bodies=[_body(body, mechanism, joints) for body in mechanism.bodies],
    )


def _gravity(gravity: Vector | None) -> str | list[str]:
    if gravity is None:
        return "none"
    if gravity == GENERIC:
        return "generic"
    return [expression_text(part) for part in gravity]


def _function(function: Spline) -> str | dict[str, Any]:
    if function.ratio is not None:
        return expression_text(function.ratio)
    knots = [
        [decimal_text(knot), expression_text(jump)] for knot, jump in function.knots
    ]
    return _stated(
        coefficients=[expression_text(c) for c in function.coefficients],
        knots=knots or None,
    )


# -- symbols --------------------------------------------------------------------------------------------------------


def _used(mechanism: Mechanism) -> list[str]:
    """Symbols that need a declaration, in order of appearance."""
    found = [name for body in mechanism.bodies for name in body.joint.symbols()]
    found += [name for value in setup_ratios(mechanism) for name in value.symbols()]
    found += [
        name
        for placed in setup_placements(mechanism)
        for e in placed.entries()
        for name in e.symbols()
    ]
    if mechanism.gravity != GENERIC:
        found += [name for part in mechanism.gravity or () for name in part.symbols()]
    return list(dict.fromkeys(found))


def _symbols(mechanism: Mechanism) -> dict[str, Any]:
    # an empty mapping declares a name that the mechanism uses but does not list
    written: dict[str, Any] = {name: {} for name in _used(mechanism)}
    return written | {
        name: _symbol(symbol) for name, symbol in mechanism.symbols.items()
    }


def _symbol(symbol: Symbol) -> str | dict[str, str] | None:
    approximate = (
        None
        if symbol.value is None or symbol.exact is not None
        else repr(float(symbol.value))
    )
    arc = None if symbol.tangent_squared is None else str(symbol.tangent_squared)
    entry = _stated(
        value=symbol.exact,
        approximate=approximate,
        tangent_squared=arc,
        meaning=symbol.meaning or None,
        fit=symbol.fit and list(symbol.fit),
    )
    return entry.get("value") if set(entry) <= {"value"} else entry


# -- bodies ---------------------------------------------------------------------------------------------------------


def _body(body: Body, mechanism: Mechanism, joints: Joints | None) -> dict[str, Any]:
    inertial = (
        None
        if body.inertial is None
        else [repr(float(value)) for value in body.inertial]
    )
    return _stated(
        name=body.name,
        label=body.label,
        parent=mechanism.bodies[body.parent].name if body.parent != GROUND else None,
        **((joints and _short_form(body, joints)) or {"joint": _custom(body.joint)}),
        massless=body.massless or None,
        parameters=[PARAMETERS[k] for k in body.carried]
        if body.carried not in ((), ALL)
        else None,
        separate=body.joint.is_fixed or None,
        inertial=None if inertial is None else {"standard": inertial},
    )


def _axis(motion: Motion) -> str:
    return ("-" if motion.sign < 0 else "") + "xyz"[motion.axis]


def _custom(joint: Joint) -> dict[str, Any]:
    steps = [
        _motion(step) if isinstance(step, Motion) else frame_data(step)
        for step in joint.steps
    ]
    return {"type": "custom", "kind": joint.kind, "name": joint.name, "steps": steps}


def _motion(motion: Motion) -> dict[str, Any]:
    written = {"motion": motion.kind.value, "name": motion.name, "axis": _axis(motion)}
    if motion.kind is MotionKind.SCREW:
        written["pitch"] = expression_text(motion.pitch)
    return written


def _short_form(body: Body, joints: Joints) -> dict[str, Any] | None:
    """Joint and frame by the joint's type, or None if that would not be the same joint."""
    from echelon.formats.description.description_builder import joint_name
    from echelon.formats.schema.robot_schema import BodyEntry

    if body.joint.kind not in _TYPES:
        return None
    written = _guess(body.joint)
    entry = BodyEntry.model_validate({"name": body.name, **written})
    try:
        same = (
            joints.body(entry, "", "") == body.joint.steps
            and joint_name(entry) == body.joint.name
        )
    except InputError:
        return None
    return written if same else None


def _guess(joint: Joint) -> dict[str, Any]:
    """The joint written in the usual form: a placement, motions, a placement."""
    steps: list[Step] = list(joint.steps)
    origin = steps.pop(0) if steps and isinstance(steps[0], Placement) else Placement()
    frame = steps.pop() if steps and isinstance(steps[-1], Placement) else Placement()
    assert isinstance(origin, Placement)
    assert isinstance(frame, Placement)
    written: dict[str, Any] = {"type": joint.kind, "name": joint.name}
    if not origin.is_identity:
        written["origin"] = frame_data(origin)
    motions = joint.motions or (Motion(MotionKind.ROTATION, ""),)
    if joint.kind not in ("spherical", "floating", "fixed"):
        written["axis"] = _axis(motions[-1] if joint.kind == "planar" else motions[0])
    if joint.kind == "helical":
        written["pitch"] = expression_text(motions[0].pitch)
    if joint.kind == "universal":
        # any other second axis fails the comparison, whatever stands here
        perpendicular = len(motions) > 1 and motions[1].axis != motions[0].axis
        written["axis2"] = (
            _axis(motions[1]) if perpendicular else "xyz"[(motions[0].axis + 1) % 3]
        )
    if frame.is_identity:
        return {"joint": written}
    return {"joint": written, "frame": frame_data(frame)}


def _reader(mechanism: Mechanism) -> Joints:
    """A reader of joints that knows the mechanism's symbols."""
    from echelon.formats.description.description_builder import Joints
    from echelon.formats.description.document import Document, Expressions
    from echelon.formats.snapping import ReadingOptions

    symbols = {name: Symbol(name) for name in (*_used(mechanism), *mechanism.symbols)}
    return Joints(
        Expressions(Document({}, mechanism.name), ReadingOptions(), (), symbols)
    )
