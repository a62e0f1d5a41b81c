"""Objects of the public classes, made and used as a user would; and which classes are public."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import echelon as ec
from echelon.compute import TensorLibrary
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.excite.closeness import Closeness, PairDistance
from echelon.excite.problem.shapes import Shape, ShapeKind
from echelon.formats.robot_file import RobotFile
from echelon.identification.advantage import Advantage
from echelon.identification.conditioning import conditioning
from echelon.identification.judge.hypothesis import Kind, Usual
from echelon.identification.judge.judge import Judged
from echelon.identification.masses import BodyMass
from echelon.identification.servos.servo_fit import ServoLimit, ServoScore
from echelon.robot.effect import KINDS
from support.paths import EXAMPLES, ROOT
from support.pendulum_logs import pendulum, write_log

STATE = dict(
    zip(
        ("q", "qd", "qdd"),
        np.random.default_rng(0).normal(size=(3, 1500, 2)),
        strict=True,
    )
)
LOG = {**STATE, "y": np.random.default_rng(1).normal(size=(1500, 2))}
MOTION = {
    "duration": 4,
    "starts": 1,
    "harmonics": 2,
    "limits": {"velocity": 3, "position": [-2, 2]},
}
FILES = {
    "gripper.urdf": """<robot name="gripper"><link name="base"/><link name="finger"/><link name="thumb"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="finger"/><axis xyz="0 0 1"/>
<origin rpy="1.5708 0 0.3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="finger"/><child link="thumb"/><axis xyz="0 1 0"/>
<origin xyz="0.3 0.01 0"/><mimic joint="j1" multiplier="-1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>""",
    "added.yaml": "echelon: 1\nname: added\nrobot: {file: gripper.urdf}\neffects: [{type: viscous, at: all}]\n",
    "leg.yaml": """echelon: 1
name: leg
gravity: [0, -9.81, 0]
symbols: {l1: 0.5}
modified_dh: [{joint: revolute, name: hip}, {joint: revolute, name: knee, a: l1}, {joint: prismatic, name: lift}]
couplings: [{lift: {spline: {of: knee, points: [[-2, 0.03], [-1, 0.01], [0, 0], [0.5, 0.004]]}}}]
actuators: {m1: 32*hip, m2: 45*knee + 2*hip}
effects: [{type: coulomb, at: all}]
outputs: [{actuator: all}, {wrench: base}]
""",
    "special.yaml": """echelon: 1
name: special
gravity: [0, 0, -9.81]
symbols: {a2: 0, a3: 0.3}
modified_dh: [{joint: revolute}, {joint: revolute, a: a2}, {joint: revolute, alpha: pi/2, a: a3}]
excitation: {frames: [{body: link3, above: {normal: [0, 1, 0], offset: -9}}]}
identification: {bodies: {link3: {mass: [0, 5]}}}
""",
    "snake.yaml": "echelon: 1\nname: snake\nmodified_dh:\n"
    + "  - {joint: revolute, alpha: pi/2, d: 0.1}\n" * 13,
    "touching.yaml": """echelon: 1
name: touching
modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2, a: 0.3}, {joint: revolute, a: 0.2}, {joint: revolute}]
contacts: [{body: j4}]
""",
    "bristles.yaml": """echelon: 1
name: bristles
modified_dh: [{joint: revolute}]
effects: [{type: lugre, at: j1, stiffness: 1000, velocity: 0.1, ratio: 1.5}]
""",
    "held.yaml": """echelon: 1
name: held
modified_dh: [{joint: revolute}, {joint: revolute, a: 0.3}]
locked: {j2: 0.5}
log: {position: {j1: q1, j2: q2}}
""",
    "tilted.yaml": """echelon: 1
name: tilted
modified_dh: [{joint: revolute}, {joint: revolute, a: 0.3}]
log: {position: {j1: q1, tilt: t}, sensors: {tilt: j1 + j2}}
""",
    "longer.urdf": (EXAMPLES / "so101.urdf").read_text().replace("-0.1349", "-0.1449"),
    "wrong.txt": "ZZ1 + l1^2*M2 + M1\nMX1 + l1*M2\nMY1\nZZ2\nMX2\n",
}


@dataclass(frozen=True)
class Example:
    """How to make an object, and what it says when it is used: what a copy of it must say too."""

    make: Callable[[], Any]
    use: Callable[[Any], Any] = repr


@cache
def used(name: str) -> tuple[Any, Any]:
    """One of the objects, and what it said when it was used."""
    found = OBJECTS[name].make()
    return found, OBJECTS[name].use(found)


# -- objects -----------------------------------------------------------------------------------------------------------


@cache
def folder() -> TemporaryDirectory[str]:
    """Files that examples are read from; removed when the interpreter ends."""
    found = TemporaryDirectory(prefix="echelon-tests-")
    for name, text in FILES.items():
        (Path(found.name) / name).write_text(text)
    write_log(Path(found.name) / "run.parquet", 3000, seed=3)
    return found


def file(name: str) -> Path:
    return Path(folder().name) / name


@cache
def base() -> ec.BaseModel:
    return ec.base_parameters(ec.load(EXAMPLES / "double_pendulum.yaml"))


@cache
def setup() -> ec.Setup:
    found = pendulum()
    return found.with_settings(physical=True, essential="bic")


@cache
def identification() -> ec.Identification:
    return ec.identify(setup(), [file("run.parquet")])


@cache
def calibration() -> ec.Calibration:
    place = EXAMPLES / "calibration"
    return ec.calibrate(place / "arm.yaml", place / "tracker.csv")


def hypothesis() -> Judged:
    places = ("j1",), ("{type: rotor_inertia, at: {at}}",)
    rises = (0.9,), (0.99,)
    return Judged(
        Kind.EFFECT,
        "the acceleration qdd",
        places[1][0],
        Usual.EVERYWHERE,
        Advantage(0.5, 0.01),
        *places,
        *rises,
    )


def identified() -> Any:
    ec.save_identification(identification(), file("model.json"))
    return ec.load_identified(file("model.json"))


def servo() -> ec.ServoFit:
    score = ServoScore("j1", 0.01, 0.99, 0.9)
    limits = (ServoLimit("j1", "torque", 0.1, 0.01, 0.2),)
    of = (
        base(),
        identification().estimate,
        0.1,
        0.01,
        (),
        (score,),
        (score,),
        (),
        ("run.parquet",),
        True,
        limits,
    )
    return ec.ServoFit(*of)


def prediction() -> Any:
    model = identified()
    return ec.predict_log(model.plan, model.values, file("run.parquet"))


def structure() -> ec.Structure:
    from support.many_cranks import cranks

    return ec.base_structure(cranks("0.7"))


def little() -> Any:
    """Conditioning of data that hold one joint still."""
    still = {name: values * [0, 1] for name, values in STATE.items()}
    observation = base().accumulate({**still, "y": LOG["y"]})
    found = conditioning(observation, np.ones(2), base())
    assert found.weak
    return found


def gains() -> Any:
    from echelon.identification.payload import Payload
    from support.payloads import truth
    from support.textbook_arms import modified_dh

    arm = modified_dh(
        "arm", "R 0 0 0", "R -pi/2 0 0", "R 0 a2 0", values={"a2": "0.4", "g": "9.81"}
    )
    payload = Payload("link3", {"M": 4.9})
    true = truth(arm, "link3")
    return ec.drive_gains(
        true.base, *true.observations(1, 0.01, payload, count=300), payload
    )


# -- what is done with them --------------------------------------------------------------------------------------------


def computed(model: ec.BaseModel) -> list[Any]:
    """Everything that a base model compiles code for."""
    values, q, qd = np.arange(1.0, model.rank + 1), STATE["q"], STATE["qd"]
    numbers = [
        model.regressor(**STATE),
        model.standard_regressor(**STATE),
        model.predict(**STATE, values=values),
    ]
    numbers += [
        model.mass_matrix(q, values),
        model.gravity(q, values),
        model.coriolis(q, qd, values),
    ]
    numbers += [
        model.regressor_entries(**STATE),
        *model.inverse_dynamics_derivatives(**STATE, values=values),
    ]
    numbers += [
        *model.accumulate(LOG).factors,
        *model.normal_equations(LOG).grams,
        model.B_float(),
        model.lift(values),
    ]
    return [
        *numbers,
        str(model),
        str(model.B_exact),
        model.symbolic_regressor().latex(),
        model.classification,
    ]


def along_loop(model: ec.BaseModel) -> list[Any]:
    q, qd, qdd = np.random.default_rng(2).normal(scale=0.1, size=(3, 5, 1))
    q = q + model.mechanism.assembly["crank"]
    return [str(model), model.regressor(q, qd, qdd), repr(model.reduced)]


def read_literally(mechanism: ec.Mechanism) -> list[Any]:
    """Mechanisms that are built again from the file of a mechanism."""
    reading = mechanism.reading
    assert reading is not None
    again = reading.recoupled()
    other = [] if again is None else [str(again)]
    return [
        str(reading.literal()),
        str(mechanism),
        repr(mechanism),
        [str(s) for s in reading.snaps],
        *other,
    ]


def linear(found: ec.LinearBase) -> list[Any]:
    names = {i.name for i in found.model.regressor.program.inputs.values()}
    given = {
        name: np.linspace(0.1, 1, 5) for name in names - found.model.constants.keys()
    }
    return [
        str(found),
        found.regressor(given, dict.fromkeys(found.model.constants, 1.5)),
        repr(found.certificate),
    ]


def run(setup: ec.Setup) -> list[Any]:
    return [repr(setup), *read_literally(setup.mechanism)]


def shown(found: ec.Identification) -> list[Any]:
    return [ec.report_html(found), found.estimate.values, computed(found.base)]


def moved(found: ec.ExcitingTrajectory) -> list[Any]:
    return [
        ec.preview_html(found),
        found.trajectory(np.linspace(0, 4, 9)),
        str(found.base),
    ]


def online() -> ec.OnlineEstimator:
    estimator = ec.online(base(), forgetting=0.99)
    estimator.update(**{name: values[:50] for name, values in LOG.items()})
    return estimator


def load(name: str, **options: Any) -> Callable[[], ec.Mechanism]:
    return lambda: ec.load(
        EXAMPLES / name if (EXAMPLES / name).exists() else file(name), **options
    )


def error(kind: type[Exception], *values: Any, **named: Any) -> Example:
    return Example(
        lambda: kind(*values, **named),
        lambda found: (str(found), found.args, vars(found)),
    )


OBJECTS: Mapping[str, Example] = {
    "calibration": Example(calibration, lambda found: found.written.text),
    "measurements": Example(
        lambda: ec.load_setup(EXAMPLES / "calibration" / "arm.yaml")
    ),
    "calibration score": Example(lambda: calibration().scores[0]),
    "calibration poses": Example(
        lambda: ec.calibration_poses(EXAMPLES / "calibration" / "arm.yaml", 12)
    ),
    "description": Example(load("double_pendulum.yaml"), read_literally),
    "description in numbers": Example(
        load("double_pendulum.yaml", symbolic=False), read_literally
    ),
    "actuators, a spline": Example(load("leg.yaml"), read_literally),
    "URDF": Example(load("gripper.urdf"), read_literally),
    "URDF in numbers": Example(load("gripper.urdf", symbolic=False), read_literally),
    "additions to a URDF": Example(load("added.yaml"), read_literally),
    "MJCF": Example(load("two_link.xml"), read_literally),
    "loop": Example(load("loops/four_bar.yaml"), read_literally),
    "base": Example(base, computed),
    "arrays": Example(  # NumPy in the place of JAX and PyTorch, which do not like to be forked
        lambda: base()._tensors(TensorLibrary("numpy", "asarray"), None),
        lambda found: found.gravity(np.ones(2), np.ones(6)),
    ),
    "online": Example(online, lambda found: (repr(found), found.estimate().values)),
    "servo fit": Example(servo),
    "base of a loop": Example(
        lambda: ec.base_parameters(load("loops/four_bar.yaml")()), along_loop
    ),
    "base in numbers": Example(
        lambda: ec.base_parameters(load("double_pendulum.yaml")(), budget=0), str
    ),
    "base of a URDF": Example(lambda: ec.base_parameters(load("gripper.urdf")()), str),
    "base at special values": Example(
        lambda: ec.base_parameters(load("special.yaml")()), str
    ),
    "structure": Example(structure),
    "structure of a loop": Example(
        lambda: ec.base_structure(load("loops/parallelogram.yaml")())
    ),
    "linear model": Example(
        lambda: ec.load_linear(EXAMPLES / "linear" / "arrhenius.yaml")
    ),
    "linear base": Example(
        lambda: ec.base_parameters(
            ec.load_linear(EXAMPLES / "linear" / "single_track.yaml")
        ),
        linear,
    ),
    "formulas": Example(
        lambda: base().symbolic_regressor(), lambda found: found.latex()
    ),
    "size of a leaf": Example(
        lambda: virtual_power_form(base().mechanism).sampler().leaf_size
    ),
    "rows of many bodies": Example(lambda: virtual_power_form(load("snake.yaml")())),
    "ranks": Example(
        lambda: ec.compare_numeric(base().mechanism),
        lambda found: (repr(found), found.verdict),
    ),
    "special": Example(lambda: ec.special_geometry(base().mechanism)),
    "energy": Example(lambda: ec.energy_regressor(base().mechanism)),
    "match": Example(lambda: ec.match(base(), base())),
    "row spaces": Example(
        lambda: ec.same_row_space(base(), ec.energy_regressor(base().mechanism))
    ),
    "comparison": Example(lambda: ec.compare(*[EXAMPLES / "so101.urdf"] * 2)),
    "comparison of other inertias": Example(
        lambda: ec.compare(
            EXAMPLES / "so101.urdf", ROOT / "docs/examples/so101_cad.urdf"
        )
    ),
    "comparison of other lengths": Example(
        lambda: ec.compare(EXAMPLES / "so101.urdf", file("longer.urdf"))
    ),
    "experiment": Example(lambda: ec.Experiment(EXAMPLES / "panda.yaml", "table")),
    "contacts": Example(load("touching.yaml"), read_literally),
    "bristles": Example(load("bristles.yaml"), read_literally),
    "a law of friction": Example(lambda: KINDS["viscous"]),
    "locked joints": Example(lambda: ec.load_setup(file("held.yaml"))),
    "sensors of the motion": Example(lambda: ec.load_setup(file("tilted.yaml"))),
    "equality": Example(lambda: ec.Equality.EQUAL),
    "sensors": Example(lambda: ec.sensor_report(base().mechanism)),
    "driven": Example(lambda: ec.sampled_rank(base(), STATE)),
    "audit": Example(lambda: ec.audit(base(), file("wrong.txt")), str),
    "source": Example(
        lambda: ec.generate(base()), lambda found: (dict(found), repr(found.functions))
    ),
    "verdict": Example(lambda: ec.audit(base(), file("wrong.txt")).verdict),
    "observation": Example(lambda: base().accumulate(LOG), lambda found: found.factors),
    "triangle": Example(
        lambda: base().accumulate(LOG).combined(), lambda found: found.solve()
    ),
    "what little data show": Example(little),
    "normal equations": Example(
        lambda: base().normal_equations(LOG), lambda found: found.grams
    ),
    "setup": Example(lambda: ec.load_setup(EXAMPLES / "logs" / "emps.yaml"), run),
    "setup of a URDF": Example(lambda: ec.load_setup(file("gripper.urdf")), run),
    "setup of an excitation": Example(
        lambda: ec.load_setup(EXAMPLES / "excite" / "ur10.yaml"), repr
    ),
    "payload": Example(lambda: ec.Payload("j2", {"M": 0.5})),
    "gains": Example(gains),
    "mass of a load": Example(
        lambda: BodyMass("load", 1.2, 1.1, 1.3, *np.zeros((3, 3))), repr
    ),
    "identification": Example(identification, shown),
    "hypothesis": Example(hypothesis),
    "what a fit covers": Example(lambda: identification().ranges, repr),
    "identified model": Example(identified, lambda found: (repr(found), found.values)),
    "rows": Example(
        lambda: identified().plan.rows([file("run.parquet")]),
        lambda found: found.observation().factors,
    ),
    "block of rows": Example(
        lambda: next(identified().plan.rows([file("run.parquet")]).blocks()), repr
    ),
    "samples": Example(lambda: next(identified().plan.samples(file("run.parquet")))),
    "prediction": Example(prediction, lambda found: found.predicted),
    "excitation": Example(lambda: ec.exciting_trajectory(setup(), **MOTION), moved),
    "obstacle": Example(lambda: Shape("wall", -1, ShapeKind.PLANE, (), np.eye(4))),
    "distances": Example(
        lambda: Closeness(
            np.arange(2.0),
            (PairDistance("distance of a and b", False, 0.02, np.ones(2)),),
        )
    ),
    "limits": Example(lambda: ec.load_setup(file("special.yaml")), run),
    "AssemblyWarning": error(ec.AssemblyWarning, "moved"),
    "DoubtWarning": error(ec.DoubtWarning, "doubtful"),
    "EchelonError": error(ec.EchelonError, "wrong"),
    "InputError": error(ec.InputError, "wrong", source="arm.yaml", element="joint"),
    "MissingExtraError": error(ec.MissingExtraError, "scipy", "excite"),
    "ClosedFormError": error(ec.ClosedFormError, "none"),
    "CertificateError": error(ec.CertificateError, "wrong"),
}
"""Together they hold an object of every public class but those of devices."""


# -- public classes ----------------------------------------------------------------------------------------------------


@cache
def _own_classes() -> dict[str, list[type]]:
    """Every class of the package, by name."""
    found: dict[str, list[type]] = {}
    for info in pkgutil.walk_packages(ec.__path__, "echelon."):
        if not info.name.endswith("__main__"):
            members = vars(importlib.import_module(info.name)).items()
            for name, member in members:
                if inspect.isclass(member) and member.__module__ == info.name:
                    found.setdefault(name, []).append(member)
    return found


def _named(annotation: object, module: str) -> Iterator[type]:
    """Classes of the package that an annotation of a module names."""
    for name in re.findall(r"[A-Za-z]\w+", str(annotation)):
        member = vars(sys.modules[module]).get(name)
        if inspect.isclass(member) and member.__module__.startswith("echelon."):
            # marks in annotations say how a value is checked, and no object holds them
            if member.__module__ != "echelon.shared.records":
                yield member
        elif member is None:  # imported for type checkers only
            yield from _own_classes().get(name, [])


def _says(kind: type) -> Iterator[type]:
    """Classes that the attributes, properties and methods of a class give."""
    for owner in kind.__mro__:
        if owner.__module__.startswith("echelon."):
            for annotation in inspect.get_annotations(owner).values():
                yield from _named(annotation, owner.__module__)
            for name, member in vars(owner).items():
                given = (
                    member.fget
                    if isinstance(member, property)
                    else getattr(member, "func", member)
                )
                if inspect.isfunction(given) and not name.startswith("_"):
                    yield from _named(
                        given.__annotations__.get("return"), given.__module__
                    )


def public_classes() -> set[type]:
    """Classes that users meet: of the public names, of what they return, and of what that holds."""
    waiting: list[type] = []
    for name in ec.__all__:
        member = getattr(ec, name)
        if inspect.isclass(member):
            waiting.append(member)
        elif inspect.isfunction(member):
            returned = member.__annotations__.get("return")
            waiting += _named(returned, member.__module__)
    found: set[type] = set()
    while waiting:
        kind = waiting.pop()
        if kind not in found:
            found.add(kind)
            # what a robot file is parsed into is for its readers, and parsed again in other processes
            waiting += [] if kind is RobotFile else _says(kind)
    return found


def held(*roots: object) -> dict[type, list[Any]]:
    """Objects of the package's classes that some objects hold, themselves included, by class."""
    found: dict[type, list[Any]] = {}
    waiting, seen = list(roots), dict[int, object]()
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen[id(item)] = item
        if isinstance(item, Mapping):
            waiting += [*item.keys(), *item.values()]
        elif isinstance(item, tuple | list | set | frozenset):
            waiting += item
        elif isinstance(item, partial):
            waiting += [getattr(item.func, "__self__", None), *item.args]
        if type(item).__module__.startswith("echelon."):
            for kind in type(item).__mro__:
                found.setdefault(kind, []).append(item)
            waiting += getattr(item, "__dict__", {}).values()
            waiting += [
                getattr(item, name, None)
                for name in getattr(type(item), "__slots__", ())
            ]
    return found
