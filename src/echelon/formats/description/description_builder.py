"""From a description to a mechanism: floating base, lumping of fixed parts, labels, couplings.

Its three forms are read as one: parts, each with a parent and a joint, parents first.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np

from echelon.algebra import is_whole
from echelon.formats.bodies import BASE, Bodies, Part, with_relations
from echelon.formats.builder import Built
from echelon.formats.description.couplings import offset_placement, read_couplings
from echelon.formats.description.document import (
    Document,
    Expressions,
    check_use,
    coordinate_axis,
    cut_off,
    declared_symbols,
    with_intended_angles,
)
from echelon.formats.description.stated_setup import ADDITIONS, Additions
from echelon.formats.literal import (
    MOTIONS,
    LiteralMotion,
    StatedCoupling,
    move_inertial,
)
from echelon.formats.schema.robot_schema import (
    BodyEntry,
    ModifiedRow,
    RobotDescription,
    StandardRow,
)
from echelon.formats.schema.schema_types import (
    AxisJoint,
    CustomJoint,
    HelicalJoint,
    MotionStep,
)
from echelon.formats.schema.schema_types import Joint as Entry
from echelon.formats.snapping import ReadingOptions, gravity_vector
from echelon.robot import (
    ALL,
    GROUND,
    ORIGIN,
    Body,
    Joint,
    Mechanism,
    Motion,
    MotionKind,
    Placement,
    Step,
    X,
    Z,
    ball,
    floating_motions,
    merge,
    placement_matrix,
    rotation,
    screw,
    shift,
    stated_impossibilities,
    translation,
)
from echelon.shared import (
    PARAMETERS,
    Floats,
    InputError,
    nearest,
    nearest_of,
    symbol_stem,
    unused,
)


def build_description(
    document: Document,
    robot: RobotDescription,
    options: ReadingOptions,
    literal: Collection[str] = (),
) -> Built:
    """Interpret a description."""
    if robot.labels:
        raise document.error(
            "labels",
            "is for bodies of a robot file; here a label is stated with each body",
        )
    symbols, bare = declared_symbols(robot, document)
    options = replace(options, looped=bool(robot.loops))
    expressions = Expressions(document, options, literal, symbols)
    floating = robot.floating_base or options.floating
    tree = _Tree(
        read_parts(robot, expressions), floating, cut_off(robot), options, expressions
    )
    couplings = tree.couple(robot) if robot.couplings else []
    text = robot.gravity
    stated = (
        gravity_vector(text, ORIGIN)
        if isinstance(text, str)
        else expressions.vector(text, "gravity")
    )
    gravity = gravity_vector(options.gravity, stated or ORIGIN)
    bodies, snapping = tree.bodies, expressions.snapping
    connected = [
        entry if isinstance(entry, tuple) else entry.connects for entry in robot.loops
    ]
    paths = [f"loops[{k}].connects" for k in range(len(connected))]
    ends = [
        (tree.find(a, f"{p}[0]")[0], tree.find(b, f"{p}[1]")[0])
        for p, (a, b) in zip(paths, connected, strict=True)
    ]
    bodies, gravity = with_relations(
        bodies, gravity, snapping, tree.lumped.sources, expressions.declared, ends
    )
    mechanism = Mechanism(
        robot.name,
        tuple(bodies),
        gravity,
        tuple(c.coupling for c in couplings),
        {name: s for name, s in snapping.symbols.items() if name not in bare},
    )
    if not robot.model_fields_set.isdisjoint(ADDITIONS):
        mechanism = Additions(mechanism, robot, expressions, tree.find).added()
    mechanism = with_intended_angles(mechanism, snapping)
    notes = (*tree.notes, *check_use(mechanism, robot, document))
    return Built(mechanism, snapping, notes)


class _Tree:
    """Turns parts into bodies."""

    def __init__(
        self,
        parts: list[Part],
        floating: bool,
        cut: Collection[str],
        options: ReadingOptions,
        expressions: Expressions,
    ) -> None:
        self.parts, self.options, self.expressions = parts, options, expressions
        self.floating, self.cut = floating, cut
        self.massless = self._massless()
        self.notes: list[str] = []
        first = parts[0] if parts else None
        # a base that is a body of its own is number 0, so that the numbers of the others stay what they are
        kept = (
            first is not None
            and not first.moves
            and (first.separate or options.keep_fixed_links)
        )
        self.lumped = Bodies(0 if floating or kept else 1)
        self._riders: dict[int, list[Part]] = {}
        self._coordinates: dict[str, str] = {}
        if floating and first is not None and first.kind == "floating":
            problem = f"body '{first.name}' floats already, by its own joint: leave floating_base (--floating) out"
            raise expressions.error("floating_base", problem)
        if floating and (first is None or first.moves):
            # the base becomes a body, because the first part moves against it
            name = unused(BASE, {part.name for part in parts})
            joint = Joint(BASE, "floating", floating_motions(BASE))
            self.lumped.add_base(
                Body(name, "0", GROUND, joint, () if BASE in options.massless else ALL)
            )
            self._check_coordinates("floating_base")
        for part in parts:
            self._add(replace(part, carried=()) if part.name in self.massless else part)
        for index, riders in self._riders.items():
            self.bodies[index] = self._loaded(self.bodies[index], riders)

    @property
    def bodies(self) -> list[Body]:
        """The bodies so far."""
        return self.lumped.made

    # -- bodies ----------------------------------------------------------------------------------------------------

    def _add(self, part: Part) -> None:
        floats = self.floating and not self.bodies and not part.moves
        if (
            part.moves
            or part.separate
            or part.name in self.cut
            or self.options.keep_fixed_links
            or floats
        ):
            self.lumped.add(part, floats=floats)
            self._check_coordinates(part.elements[0])
            return
        steps = part.steps(symbol_stem(part.name))
        self.lumped.attach(part, lambda _: steps)
        if self.lumped.host[part.name] != GROUND:
            self._riders.setdefault(self.lumped.host[part.name], []).append(part)

    def _check_coordinates(self, path: str) -> None:
        """Names of the last body's coordinates, which no other body may have."""
        for motion in self.bodies[-1].joint.motions:
            if not motion.name:
                raise self.expressions.error(
                    f"{path}.joint.name", "a joint that moves needs a name"
                )
            if motion.name in self._coordinates:
                problem = f"the coordinate '{motion.name}' occurs already in {self._coordinates[motion.name]}"
                raise self.expressions.error(path, problem)
            self._coordinates[motion.name] = path

    def find(self, name: str | None, path: str) -> tuple[int, Placement]:
        """The body that carries a part, and where the part sits on it; None is the fixed world."""
        if name is None:
            return GROUND, Placement()
        if name in self.lumped.host:
            return self.lumped.place(name)
        self.expressions.check(
            name, [BASE, *(part.name for part in self.parts)], path, "body"
        )
        return self.lumped.place(None)

    # -- inertial values -------------------------------------------------------------------------------------------

    def _massless(self) -> frozenset[str]:
        names = [part.name for part in self.parts]
        for name in self.options.massless:
            if name not in names and not (name == BASE and self.floating):
                source = self.expressions.document.source
                raise InputError(
                    f"no body '{name}' to declare massless{nearest_of(name, names)}",
                    source=source,
                )
        stated = {part.name for part in self.parts if not part.carried}
        return frozenset(stated | set(self.options.massless))

    def _loaded(self, body: Body, riders: list[Part]) -> Body:
        """A body with the parts that are fixed to it."""
        loaded = body.massless and not all(
            part.name in self.massless for part in riders
        )
        carried = ALL if loaded else body.carried
        if body.inertial is None and not body.massless:
            return body
        total = (
            np.array(body.inertial)
            if body.inertial is not None and not body.massless
            else None
        )
        faults = (
            () if total is None else stated_impossibilities(body.name, body.inertial)
        )
        for part in riders:
            if part.inertial is None:
                continue
            moved = self._moved(part)
            if moved is None:
                self.notes.append(
                    f"inertial values of '{body.name}' are unknown: '{part.name}' sits at a symbolic place"
                )
                return replace(body, carried=carried, inertial=None)
            total = moved if total is None else total + moved
            faults += stated_impossibilities(part.name, part.inertial)
        values = None if total is None else tuple(float(v) for v in total)
        return replace(body, carried=carried, inertial=values, impossible=faults)

    def _moved(self, part: Part) -> Floats | None:
        """Parameters of a fixed part about the frame of its body, if all symbols on the way have values."""
        _, place = self.lumped.place(part.name)
        known = self.expressions.snapping.known
        if not known.keys() >= set(place.symbols()):
            return None
        return move_inertial(np.array(part.inertial), placement_matrix(place, known))

    # -- couplings -------------------------------------------------------------------------------------------------

    def couple(self, robot: RobotDescription) -> list[StatedCoupling]:
        """Read the couplings and move their constant parts into the joints."""
        motions = {m.name: m for body in self.bodies for m in body.joint.motions}
        couplings = read_couplings(robot, self.expressions, motions)
        offsets = {c.coordinate: c for c in couplings if c.offset}
        for index, body in enumerate(self.bodies):
            if not any(m.name in offsets for m in body.joint.motions):
                continue
            steps: list[Step] = []
            for step in body.joint.steps:
                if isinstance(step, Motion) and step.name in offsets:
                    steps.append(
                        offset_placement(
                            offsets[step.name], step, body.label, self.expressions
                        )
                    )
                steps.append(step)
            self.bodies[index] = replace(
                body, joint=replace(body.joint, steps=merge(tuple(steps)))
            )
        return couplings


# -- parts -------------------------------------------------------------------------------------------------------------


def read_parts(robot: RobotDescription, expressions: Expressions) -> list[Part]:
    """All parts, parents before children and otherwise in the order of the document."""
    joints = Joints(expressions)
    for form, rows in (
        ("modified_dh", robot.modified_dh),
        ("standard_dh", robot.standard_dh),
    ):
        if rows is not None:
            return _sorted(_rows(form, rows, joints), expressions)
    assert robot.bodies is not None
    names = [body.name for body in robot.bodies]
    stated = [
        _body_part(body, f"bodies[{index}]", names, joints)
        for index, body in enumerate(robot.bodies)
    ]
    parts = _sorted(stated, expressions)
    for part in parts[1:]:
        if part.kind == "root":
            raise expressions.error(
                part.elements[0],
                "needs a joint; only the first body may go without one: write "
                " joint: {type: fixed, origin: {xyz: [0, 0, 0.1]}}  for one that is fixed to its parent",
            )
    return parts


# -- tables ---------------------------------------------------------------------------------------------------------


def _rows(
    form: str, rows: Sequence[ModifiedRow | StandardRow], joints: Joints
) -> list[Part]:
    names = [row.name or f"j{number}" for number, row in enumerate(rows, 1)]
    for index, name in enumerate(names):
        if is_whole(name):
            problem = f"'{name}' would be confused with the number of a row: use a name such as j{name}"
            raise joints.expressions.error(f"{form}[{index}].name", problem)
    return [
        _row_part(row, index, f"{form}[{index}]", names, joints)
        for index, row in enumerate(rows)
    ]


def _row_part(
    row: ModifiedRow | StandardRow,
    index: int,
    path: str,
    names: Sequence[str],
    joints: Joints,
) -> Part:
    stated = getattr(
        row, "parent", None
    )  # rows of the standard convention form a chain
    return Part(
        (path,),
        names[index],
        _antecedent(stated, index, names, f"{path}.parent", joints.expressions),
        joint=names[index],
        kind=row.joint,
        moves=row.joint != "fixed",
        steps=partial(joints.row, row, names[index], path),
        label=row.label,
        default_label=str(index + 1),
        separate=row.separate,
        carried=_carried(row),
        inertial=joints.expressions.inertial(row.inertial, f"{path}.inertial"),
    )


def _antecedent(
    stated: str | None,
    index: int,
    names: Sequence[str],
    path: str,
    expressions: Expressions,
) -> str | None:
    if stated is None:
        return names[index - 1] if index else None
    if stated in names:
        return stated
    if stated in ("0", BASE):
        return None
    if is_whole(stated) and int(stated) <= len(names):
        return names[int(stated) - 1]
    valid = (
        f"0 to {len(names)}"
        if is_whole(stated)
        else f"0 to {len(names)}, base or a name"
    )
    raise expressions.error(
        path, f"there is no row '{stated}': give {valid}{nearest(stated, names)}"
    )


# -- bodies ---------------------------------------------------------------------------------------------------------


def _body_part(
    body: BodyEntry, path: str, names: Sequence[str], joints: Joints
) -> Part:
    parent = body.parent
    if parent is not None and parent not in names:
        joints.expressions.check(parent, [BASE, *names], f"{path}.parent", "body")
        parent = None
    kind, moves = _kind(body)
    return Part(
        (path,),
        body.name,
        parent,
        joint=joint_name(body) if body.joint is not None else "",
        kind=kind,
        moves=moves,
        steps=partial(joints.body, body, path),
        label=body.label,
        separate=body.separate,
        carried=_carried(body),
        inertial=joints.expressions.inertial(body.inertial, f"{path}.inertial"),
    )


def _kind(body: BodyEntry) -> tuple[str, bool]:
    """The type of a body's joint, and whether it moves."""
    if body.joint is None:
        return "root", False
    if body.joint.type == "custom":
        return body.joint.kind, any(
            isinstance(step, MotionStep) for step in body.joint.steps
        )
    return body.joint.type, body.joint.type != "fixed"


def _carried(entry: ModifiedRow | StandardRow | BodyEntry) -> tuple[int, ...]:
    """Which of the ten parameters a part carries."""
    if entry.massless:
        return ()
    if entry.parameters is None:
        return ALL
    return tuple(sorted({PARAMETERS.index(kind) for kind in entry.parameters}))


# -- both -----------------------------------------------------------------------------------------------------------


def _sorted(parts: list[Part], expressions: Expressions) -> list[Part]:
    """Parts with parents before children; parts that already stand behind their parents keep their order."""
    by_name: dict[str, Part] = {}
    for part in parts:
        if part.name in by_name:
            taken = by_name[part.name].elements[0]
            raise expressions.error(
                f"{part.elements[0]}.name",
                f"the name '{part.name}' is taken by {taken}",
            )
        by_name[part.name] = part
    ordered: dict[str, Part] = {}
    for part in parts:
        chain: dict[str, Part] = {}
        above: Part | None = part
        while above is not None and above.name not in ordered:
            if above.name in chain:
                circle = " -> ".join(
                    [*list(chain)[list(chain).index(above.name) :], above.name]
                )
                raise expressions.error(
                    f"{part.elements[0]}.parent", f"the parents form a circle: {circle}"
                )
            chain[above.name] = above
            above = by_name[above.parent] if above.parent is not None else None
        ordered.update(reversed(chain.items()))
    return list(ordered.values())


# -- joints ------------------------------------------------------------------------------------------------------------


class Joints:
    """Reads joints with the expressions of one description.

    Every method takes the element's path, for messages, and a stem: the ending of symbols that stand for angles without
    an exact sine (``roll3`` for the stem 3).
    """

    def __init__(self, expressions: Expressions) -> None:
        self.expressions = expressions

    # -- tables ----------------------------------------------------------------------------------------------------

    def row(
        self, row: ModifiedRow | StandardRow, name: str, path: str, stem: str
    ) -> tuple[Step, ...]:
        """A row of a table."""
        motion: tuple[Motion, ...] = ()
        if row.joint != "fixed":
            motion = (rotation(name) if row.joint == "revolute" else translation(name),)
        modified = isinstance(row, ModifiedRow)
        first = (
            self._along(row, Z, "gamma", "b", path, stem) if modified else Placement()
        )
        along_z = self._along(row, Z, "theta", "d", path, stem)
        along_x = self._along(row, X, "alpha", "a", path, stem)
        # turns about an axis and shifts along it commute, and so does the motion with those about and along z
        return merge(
            (first @ along_x @ along_z, *motion)
            if modified
            else (*motion, along_z @ along_x)
        )

    def _along(
        self,
        row: ModifiedRow | StandardRow,
        axis: int,
        angle: str,
        length: str,
        path: str,
        stem: str,
    ) -> Placement:
        """Rot and Trans about and along one axis, by the keys of the angle and the length."""
        turned = self.expressions.turned(
            axis, getattr(row, angle), f"{path}.{angle}", f"{angle}{stem}"
        )
        value = self.expressions.length(getattr(row, length), f"{path}.{length}")
        return turned @ shift(value if axis == X else 0, 0, value if axis == Z else 0)

    # -- bodies ----------------------------------------------------------------------------------------------------

    def body(self, body: BodyEntry, path: str, stem: str) -> tuple[Step, ...]:
        """From the parent's frame to the body's."""
        place = self.expressions.frame(body.frame, f"{path}.frame", stem)
        if body.joint is None:
            return merge((place,))
        if body.joint.type == "custom":
            steps = self._custom(body.joint, f"{path}.joint", stem)
            # left as stated, so that a saved mechanism is read back as it was
            return steps if place.is_identity else merge((*steps, place))
        origin = self.expressions.frame(body.joint.origin, f"{path}.joint.origin", stem)
        name = joint_name(body)
        return merge(
            (origin, *self._motions(body.joint, name, f"{path}.joint", stem), place)
        )

    def _motions(
        self, joint: Entry, name: str, path: str, stem: str
    ) -> tuple[Step, ...]:
        match joint.type:
            case "fixed":
                return ()
            case "spherical":
                return (ball(name),)
            case "floating":
                return floating_motions(name)
            case "universal":
                pairs = enumerate((joint.axis, joint.axis2), 1)
                return tuple(
                    rotation(f"{name}.{i}", *coordinate_axis(axis)) for i, axis in pairs
                )
            case "helical" | "cylindrical":
                return self._along_axis(joint, name, path, stem)
        axis_joint = cast(AxisJoint, joint)
        axis = self.expressions.direction(axis_joint.axis, f"{path}.axis")
        return self.expressions.snapping.motion(
            LiteralMotion(path, name, MOTIONS[joint.type], axis), stem
        )

    def _along_axis(
        self, joint: HelicalJoint | AxisJoint, name: str, path: str, stem: str
    ) -> tuple[Step, ...]:
        direction = self.expressions.direction(joint.axis, f"{path}.axis")
        mounting, axis, sign = self.expressions.snapping.direction(
            direction, f"{path} axis", stem
        )
        motions: tuple[Motion, ...]
        if joint.type == "helical":
            motions = (
                screw(
                    name,
                    self.expressions.length(joint.pitch, f"{path}.pitch"),
                    axis,
                    sign,
                ),
            )
        else:
            motions = (
                translation(f"{name}.slide", axis, sign),
                rotation(f"{name}.turn", axis, sign),
            )
        return (mounting, *motions, mounting.inverse())

    def _custom(self, joint: CustomJoint, path: str, stem: str) -> tuple[Step, ...]:
        steps: list[Step] = []
        for index, step in enumerate(joint.steps):
            here = f"{path}.steps[{index}]"
            if isinstance(step, MotionStep):
                axis, sign = coordinate_axis(step.axis)
                pitch = self.expressions.length(step.pitch, f"{here}.pitch")
                if pitch and step.motion != "screw":
                    raise self.expressions.error(
                        f"{here}.pitch",
                        f"only a screw has a pitch, not a {step.motion}",
                    )
                steps.append(
                    Motion(MotionKind(step.motion), step.name, axis, sign, pitch)
                )
            else:
                steps.append(self.expressions.frame(step, here, stem))
        return tuple(steps)


def joint_name(body: BodyEntry) -> str:
    """Name of a body's joint."""
    stated = body.joint.name if body.joint is not None else None
    return body.name if stated is None else stated
