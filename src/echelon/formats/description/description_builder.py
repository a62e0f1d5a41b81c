"""From a description to a mechanism: floating base, lumping of fixed parts, labels, couplings.

Its three forms are read as one: parts, each with a parent and a joint, parents first.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from echelon.arrays import Floats
from echelon.conventions import PARAMETERS
from echelon.errors import InputError
from echelon.exact.polynomial import is_whole
from echelon.formats.bodies import BASE, Bodies, Part, with_relations
from echelon.formats.builder import Built, Rider
from echelon.formats.description.document import (
    Document,
    Expressions,
    check_use,
    declared_symbols,
    stated_gravity,
    with_intended_angles,
)
from echelon.formats.description.stated_joints import (
    Joints,
    coordinate_axis,
    joint_name,
    offset_placement,
    read_couplings,
)
from echelon.formats.description.stated_setup import ADDITIONS, Additions
from echelon.formats.literal import StatedCoupling, StatedJoint, central_inertial, move_inertial
from echelon.formats.snapping import ReadingOptions, gravity_vector, symbol_stem
from echelon.hints import nearest, nearest_of, unused
from echelon.inputs import step_into
from echelon.mechanism.joint import ALL, GROUND, ORIGIN, Body, Joint, Motion, Placement, Step, floating_motions, merge
from echelon.mechanism.mechanism import Mechanism, Snap
from echelon.mechanism.stated import placement_matrix

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import BodyEntry, Inertial, ModifiedRow, RobotDescription, StandardRow


def read_parts(robot: RobotDescription, expressions: Expressions) -> list[Part]:
    """All parts, parents before children and otherwise in the order of the document."""
    joints = Joints(expressions)
    for form, rows in (("modified_dh", robot.modified_dh), ("standard_dh", robot.standard_dh)):
        if rows is not None:
            return _sorted(_rows(form, rows, joints), expressions)
    assert robot.bodies is not None
    names = [body.name for body in robot.bodies]
    stated = [_body_part(body, f"bodies[{index}]", names, joints) for index, body in enumerate(robot.bodies)]
    parts = _sorted(stated, expressions)
    for part in parts[1:]:
        if part.kind == "root":
            raise expressions.error(part.elements[0], "needs a joint; only the first body may go without one")
    return parts


# -- tables ---------------------------------------------------------------------------------------------------------


def _rows(form: str, rows: Sequence[ModifiedRow | StandardRow], joints: Joints) -> list[Part]:
    names = [row.name or f"j{number}" for number, row in enumerate(rows, 1)]
    for index, name in enumerate(names):
        if is_whole(name):
            problem = f"'{name}' would be confused with the number of a row: use a name such as j{name}"
            raise joints.expressions.error(f"{form}[{index}].name", problem)
    return [_row_part(row, index, f"{form}[{index}]", names, joints) for index, row in enumerate(rows)]


def _row_part(row: ModifiedRow | StandardRow, index: int, path: str, names: Sequence[str], joints: Joints) -> Part:
    stated = getattr(row, "parent", None)  # rows of the standard convention form a chain
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
        inertial=_inertial(row.inertial, f"{path}.inertial", joints.expressions),
    )


def _antecedent(
    stated: str | None, index: int, names: Sequence[str], path: str, expressions: Expressions
) -> str | None:
    if stated is None:
        return names[index - 1] if index else None
    if stated in names:
        return stated
    if stated in ("0", BASE):
        return None
    if is_whole(stated) and int(stated) <= len(names):
        return names[int(stated) - 1]
    valid = f"0 to {len(names)}" if is_whole(stated) else f"0 to {len(names)}, base or a name"
    raise expressions.error(path, f"there is no row '{stated}': give {valid}{nearest(stated, names)}")


# -- bodies ---------------------------------------------------------------------------------------------------------


def _body_part(body: BodyEntry, path: str, names: Sequence[str], joints: Joints) -> Part:
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
        inertial=_inertial(body.inertial, f"{path}.inertial", joints.expressions),
    )


def _kind(body: BodyEntry) -> tuple[str, bool]:
    """What a joint is called, and whether it moves."""
    from echelon.formats.schema.schema_types import MotionStep

    if body.joint is None:
        return "root", False
    if body.joint.type == "custom":
        return body.joint.kind, any(isinstance(step, MotionStep) for step in body.joint.steps)
    return body.joint.type, body.joint.type != "fixed"


def _carried(entry: ModifiedRow | StandardRow | BodyEntry) -> tuple[int, ...]:
    """Which of the ten parameters a part carries."""
    if entry.massless:
        return ()
    return ALL if entry.parameters is None else tuple(sorted({PARAMETERS.index(kind) for kind in entry.parameters}))


# -- both -----------------------------------------------------------------------------------------------------------


def _inertial(stated: Inertial | None, path: str, expressions: Expressions) -> tuple[float, ...] | None:
    """The ten standard parameters about the body's frame."""
    from echelon.formats.schema.robot_schema import StandardInertial

    if stated is None:
        return None
    if isinstance(stated, StandardInertial):
        return tuple(expressions.real(text, f"{path}.standard[{i}]") for i, text in enumerate(stated.standard))
    mass = expressions.real(stated.mass, f"{path}.mass")
    if mass < 0:
        raise expressions.error(f"{path}.mass", f"'{stated.mass}' is negative")
    centre = [expressions.real(text, f"{path}.com[{i}]") for i, text in enumerate(stated.com)]
    keys = ("xx", "xy", "xz", "yy", "yz", "zz")
    moments = [expressions.real(getattr(stated.inertia, key), f"{path}.inertia.{key}") for key in keys]
    return central_inertial(mass, centre, moments, np.eye(3))


def _sorted(parts: list[Part], expressions: Expressions) -> list[Part]:
    """Parts with parents before children; parts that already stand behind their parents keep their order."""
    by_name: dict[str, Part] = {}
    for part in parts:
        if part.name in by_name:
            taken = by_name[part.name].elements[0]
            raise expressions.error(f"{part.elements[0]}.name", f"the name '{part.name}' is taken by {taken}")
        by_name[part.name] = part
    ordered: dict[str, Part] = {}
    for part in parts:
        chain: dict[str, Part] = {}
        above: Part | None = part
        while above is not None and above.name not in ordered:
            if above.name in chain:
                circle = " -> ".join([*list(chain)[list(chain).index(above.name) :], above.name])
                raise expressions.error(f"{part.elements[0]}.parent", f"the parents form a circle: {circle}")
            chain[above.name] = above
            above = by_name[above.parent] if above.parent is not None else None
        ordered.update(reversed(chain.items()))
    return list(ordered.values())


def build_description(
    document: Document,
    robot: RobotDescription,
    options: ReadingOptions,
    literal: Collection[str] = (),
    base: Callable[[ReadingOptions], Built] | None = None,
) -> Built:
    """Interpret a description."""
    if robot.robot is not None:
        assert base is not None
        return _added_to_file(document, robot, options, base)
    if robot.labels:
        raise document.error("labels", "is for bodies of a robot file; here a label is stated with each body")
    symbols, bare = declared_symbols(robot, document)
    expressions = Expressions(document, options, literal, symbols)
    floating = robot.floating_base or options.floating
    tree = _Tree(read_parts(robot, expressions), floating, _cut_off(robot), options, expressions)
    couplings = tree.couple(robot) if robot.couplings else []
    stated = stated_gravity(robot, expressions)
    chosen = stated if options.gravity == "file" else gravity_vector(options.gravity, stated or ORIGIN)
    chosen = chosen if chosen is not None and any(chosen) else None
    bodies = tree.bodies
    if not robot.loops:
        bodies, chosen = with_relations(bodies, chosen, expressions.snapping, tree.lumped.sources, expressions.declared)
    mechanism = Mechanism(
        robot.name,
        tuple(bodies),
        chosen,
        tuple(c.coupling for c in couplings),
        {name: s for name, s in expressions.snapping.symbols.items() if name not in bare},
    )
    if not robot.model_fields_set.isdisjoint(ADDITIONS):
        mechanism = Additions(mechanism, robot, expressions, tree.find).added()
    mechanism = with_intended_angles(mechanism, expressions.snapping)
    notes = (*tree.notes, *check_use(mechanism, robot, document))
    return Built(mechanism, tuple(expressions.snapping.snaps), notes)


def _added_to_file(
    document: Document, robot: RobotDescription, options: ReadingOptions, base: Callable[[ReadingOptions], Built]
) -> Built:
    """A robot file with what a description adds to it."""
    assert robot.robot is not None
    for key in ("gravity", "floating_base", "couplings"):
        if key in robot.model_fields_set:
            raise document.error(key, "belongs to the geometry, which is that of the robot file")
    joints = []
    for name, entry in robot.robot.joints.items():
        axes = tuple(coordinate_axis(axis) for axis in (entry.axis, entry.axis2) if axis is not None)
        joints.append(StatedJoint(name, entry.type, axes, partial(document.error, f"robot.joints.{name}")))
    options = replace(options, separate=_cut_off(robot), joints=tuple(joints))
    # the loops of a geometry in numbers close at these numbers only
    stated = base(replace(options, symbolic=False) if robot.loops else options)
    mechanism = stated.mechanism
    symbols, bare = declared_symbols(robot, document)
    known = {n: s for n, s in symbols.items() if n not in bare}
    expressions = Expressions(document, options, (), {**mechanism.symbols, **symbols})
    mechanism, notes = _labelled(replace(mechanism, symbols={**mechanism.symbols, **known}), robot, document)
    find = _FileParts(mechanism, stated.riders, expressions)
    mechanism = Additions(mechanism, robot, expressions, find).added()
    snaps = tuple(dict.fromkeys((*stated.snaps, *find.snaps)))
    return Built(mechanism, snaps, (*stated.notes, *notes))


def _cut_off(robot: RobotDescription) -> tuple[str, ...]:
    """Names of what force/torque sensors carry: sensors see fixed parts apart from what they are fixed to."""
    return tuple(w for w in (getattr(output, "wrench", BASE) for output in robot.outputs or ()) if w != BASE)


def _labelled(mechanism: Mechanism, robot: RobotDescription, document: Document) -> tuple[Mechanism, list[str]]:
    """A robot file's mechanism with the labels that a description gives to its bodies, and remarks."""
    names = [body.name for body in mechanism.bodies]
    for name in robot.labels:
        if name not in names:
            raise document.error(step_into("labels", name), f"there is no body '{name}'{nearest_of(name, names)}")
    bodies = [replace(body, label=robot.labels.get(body.name, body.label)) for body in mechanism.bodies]
    notes = []
    for label in dict.fromkeys(robot.labels.values()):
        sharing = [k for k, body in enumerate(bodies) if body.label == label]
        stated = [values for k in sharing if (values := bodies[k].inertial) is not None]
        if len(set(stated)) > 1:  # files round; the mean of bodies is one that can exist
            mean = tuple(float(value) for value in np.mean(stated, axis=0))
            for k in sharing:
                bodies[k] = replace(bodies[k], inertial=mean)
            notes.append(f"bodies of label '{label}' get the mean of their stated inertial values")
    return replace(mechanism, bodies=tuple(bodies)), notes


class _FileParts:
    """Finds bodies of a robot file, and what is fixed to them."""

    def __init__(
        self, mechanism: Mechanism, riders: Mapping[str, Callable[[], Rider]], expressions: Expressions
    ) -> None:
        self.names = {body.name: k for k, body in enumerate(mechanism.bodies)}
        self._joints = {body.joint.name: k for k, body in enumerate(mechanism.bodies)}
        self.riders, self.expressions, self.snaps = riders, expressions, list[Snap]()

    def __call__(self, name: str | None, path: str) -> tuple[int, Placement]:
        if name in self.names:
            return self.names[name], Placement()
        if name is not None and name in self.riders:
            rider, known = self.riders[name](), self.expressions.snapping.symbols
            for symbol in rider.symbols:
                if known.setdefault(symbol.name, symbol) != symbol:
                    problem = f"the robot file has an angle '{symbol.name}': rename the symbol"
                    raise self.expressions.error(path, problem)
            self.snaps += rider.snaps
            return rider.body, rider.placement
        if name != BASE and name in self._joints:  # a joint marks the frame that it moves
            return self._joints[name], Placement()
        if name is not None:
            self.expressions.check(name, [BASE, *self.names, *self.riders], path, "body or frame")
        return GROUND, Placement()


class _Tree:
    """Turns parts into bodies."""

    def __init__(
        self, parts: list[Part], floating: bool, cut: Collection[str], options: ReadingOptions, expressions: Expressions
    ) -> None:
        self.parts, self.options, self.expressions = parts, options, expressions
        self.floating, self.cut = floating, cut
        self.massless = self._massless()
        self.notes: list[str] = []
        first = parts[0] if parts else None
        # a base that is a body of its own is number 0, so that the numbers of the others stay what they are
        kept = first is not None and not first.moves and (first.separate or options.keep_fixed_links)
        self.lumped = Bodies(0 if floating or kept else 1)
        self._riders: dict[int, list[Part]] = {}
        self._coordinates: dict[str, str] = {}
        if floating and (first is None or (first.moves and first.kind != "floating")):
            # the base becomes a body, because the first part moves against it
            name, joint = unused(BASE, {part.name for part in parts}), Joint(BASE, "floating", floating_motions(BASE))
            self.lumped.add_base(Body(name, "0", GROUND, joint, () if BASE in options.massless else ALL))
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
        if part.moves or part.separate or part.name in self.cut or self.options.keep_fixed_links or floats:
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
                raise self.expressions.error(f"{path}.joint.name", "a joint that moves needs a name")
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
        self.expressions.check(name, [BASE, *(part.name for part in self.parts)], path, "body")
        return self.lumped.place(None)

    # -- inertial values -------------------------------------------------------------------------------------------

    def _massless(self) -> frozenset[str]:
        names = [part.name for part in self.parts]
        for name in self.options.massless:
            if name not in names and not (name == BASE and self.floating):
                source = self.expressions.document.source
                raise InputError(f"no body '{name}' to declare massless{nearest_of(name, names)}", source=source)
        stated = {part.name for part in self.parts if not part.carried}
        return frozenset(stated | set(self.options.massless))

    def _loaded(self, body: Body, riders: list[Part]) -> Body:
        """A body with what rides on it."""
        loaded = body.massless and not all(part.name in self.massless for part in riders)
        carried = ALL if loaded else body.carried
        if body.inertial is None and not body.massless:
            return body
        total = np.array(body.inertial) if body.inertial is not None and not body.massless else None
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
        values = None if total is None else tuple(float(v) for v in total)
        return replace(body, carried=carried, inertial=values)

    def _moved(self, part: Part) -> Floats | None:
        """A rider's parameters about the frame of its body, if all symbols on the way have values."""
        _, place = self.lumped.place(part.name)
        known = {n: s.value for n, s in self.expressions.snapping.symbols.items() if s.value is not None}
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
                    steps.append(offset_placement(offsets[step.name], step, body.label, self.expressions))
                steps.append(step)
            self.bodies[index] = replace(body, joint=replace(body.joint, steps=merge(tuple(steps))))
        return couplings
