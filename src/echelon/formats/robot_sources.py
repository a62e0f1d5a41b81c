"""Robots that are not files: models of MuJoCo and Pinocchio, names of the ``robot_descriptions`` package, xacro.

Each becomes the text of a robot file, in full precision, so that the readers of URDF and MJCF decide what it means.
"""

from __future__ import annotations

import re
import sys
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from echelon.formats.literal import roll_pitch_yaw
from echelon.formats.mjcf.mjcf_model import import_mujoco
from echelon.shared import InputError, extra, nearest, parse_xml, read_content

_DESCRIPTION = re.compile(r"\w+_description")
_XACRO = re.compile(rb"""xmlns:xacro\s*=\s*["']https?://[^"']*xacro/?["']""")
_MACROS = re.compile(rb"<xacro:|\$[{(]")
PACKAGE_LEVELS = 6
"""Folders above a xacro file around which packages are looked for."""
_EQUALITIES = ("connect", "weld", "joint", "tendon")
_JOINTS = ("free", "ball", "slide", "hinge")
_ONE_AXIS = re.compile(
    r"(R|P|RUB)[XYZ]|(Revolute|RevoluteUnbounded|Prismatic)Unaligned"
)
_SENSORS = {
    "mjSENS_FORCE": ("force", "site"),
    "mjSENS_TORQUE": ("torque", "site"),
    "mjSENS_JOINTACTFRC": ("jointactuatorfrc", "joint"),
    "mjSENS_ACTUATORFRC": ("actuatorfrc", "actuator"),
}


def text_of(model: Any) -> tuple[bytes, str]:
    """The text of a model in memory, and a name with the suffix of its format."""
    kind = f"{type(model).__module__.split('.')[0]}.{type(model).__name__}"
    if kind == "mujoco.MjSpec":
        model, kind = model.copy().compile(), "mujoco.MjModel"
    if kind == "mujoco.MjModel":
        root = _mjcf(model)
    elif kind.startswith("pinocchio") and hasattr(model, "jointPlacements"):
        root = _urdf(model)
    else:
        problem = "expected a path, the text of a robot file, a mujoco.MjSpec or MjModel, or a pinocchio.Model"
        raise InputError(f"{problem}; found {kind}")
    name = root.get("model") or root.get("name") or "robot"
    return tostring(root), f"{name}.{'xml' if root.tag == 'mujoco' else 'urdf'}"


def described_path(name: str) -> Path | None:
    """The file of a robot of the package ``robot_descriptions``, which fetches it; None for what is no such name."""
    if not _DESCRIPTION.fullmatch(name) or Path(name).exists():
        return None
    with extra("robots"):
        from robot_descriptions._descriptions import DESCRIPTIONS
    if name not in DESCRIPTIONS:
        raise InputError(
            f"the package robot_descriptions has no '{name}'{nearest(name, DESCRIPTIONS)}"
        )
    try:
        with redirect_stdout(sys.stderr):  # it says what it fetches
            module = import_module(f"robot_descriptions.{name}")
    except Exception as error:  # whatever git and the network raise
        raise InputError(
            f"robot_descriptions cannot fetch it: {error}", source=name
        ) from None
    paths = (
        getattr(module, attribute, None)
        for attribute in ("URDF_PATH", "MJCF_PATH", "XACRO_PATH")
    )
    return Path(next(path for path in paths if path))


def expanded(content: bytes, source: str, directory: Path | None) -> bytes:
    """The URDF that xacro source stands for, any other text as it is; packages are looked for around its directory."""
    if not (
        _XACRO.search(content) and _MACROS.search(content)
    ):  # that the namespace is declared says nothing
        return content
    parse_xml(content, source)  # refuses what is damaged or harmful
    with extra("robots"):
        import xacro
        from xacrodoc import packages
    try:
        if directory is None:
            xacro.restore_filestack([None])
            document = xacro.parse(content.decode())
            xacro.process_doc(document)
        else:
            packages.reset()  # it remembers where packages of other robots were
            packages.look_in(
                [str(folder) for folder in Path(source).absolute().parents[:3]]
            )
            packages.update_package_cache(_packages_around(Path(source)))
            document = xacro.process_file(source)
        return bytes(document.toxml().encode())
    except (
        Exception,
        SystemExit,
    ) as error:  # whatever the expressions of a file stumble over
        reason = str(error) or type(error).__name__
        problem = f"xacro cannot expand it: {reason}; expand it where its packages are: xacro robot.xacro > robot.urdf"
        raise InputError(problem, source=source) from None


def _packages_around(file: Path) -> dict[str, Path]:
    """The folders above a file and beside these, by the names of their package.xml and by their own.

    The nearest folder of a name counts, and a name that a package.xml states before that of a folder.
    """
    stated: dict[str, Path] = {}
    by_folder: dict[str, Path] = {}
    for folder in file.resolve().parents[:PACKAGE_LEVELS]:
        try:
            beside = sorted(child for child in folder.iterdir() if child.is_dir())
        except OSError:  # a folder that nobody may list holds no packages for us
            beside = []
        for package in (folder, *beside):
            by_folder.setdefault(package.name, package)
            if name := _package_name(package / "package.xml"):
                stated.setdefault(name, package)
    return by_folder | stated


def _package_name(file: Path) -> str:
    """The name that a package.xml states; empty if there is none."""
    if not file.is_file():
        return ""
    try:
        root = parse_xml(read_content(file), str(file))
    except InputError:
        return ""
    return str(root.findtext("name", "")).strip()


# -- MuJoCo ------------------------------------------------------------------------------------------------------------


def _mjcf(model: Any) -> Element:
    """A compiled model with the bodies, joints, inertias and equalities that it has."""
    root = Element("mujoco", model=model.names.split(b"\0")[0].decode() or "robot")
    SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    disabled, bits = model.opt.disableflags, import_mujoco().mjtDisableBit
    weightless = disabled & bits.mjDSBL_GRAVITY
    SubElement(
        root, "option", gravity="0 0 0" if weightless else _row(model.opt.gravity)
    )
    elements = {0: SubElement(root, "worldbody")}
    for k in range(1, model.nbody):
        body = model.body(k)
        placed = {
            "name": _name(model, "body", k),
            "pos": _row(body.pos),
            "quat": _row(body.quat),
        }
        element = SubElement(elements[int(body.parentid[0])], "body", placed)
        elements[k] = element
        for j in range(int(body.jntadr[0]), int(body.jntadr[0]) + int(body.jntnum[0])):
            SubElement(element, "joint", _mjcf_joint(model, j))
        if body.mass[0] or body.inertia.any():
            inertia = {"mass": _row(body.mass), "diaginertia": _row(body.inertia)}
            SubElement(
                element,
                "inertial",
                {"pos": _row(body.ipos), "quat": _row(body.iquat), **inertia},
            )
    for k in range(model.nsite):
        site = model.site(k)
        placed = {
            "name": _name(model, "site", k),
            "pos": _row(site.pos),
            "quat": _row(site.quat),
        }
        SubElement(elements[int(site.bodyid[0])], "site", placed)
    tendons = SubElement(root, "tendon")
    for k in range(model.ntendon):
        _add_fixed_tendon(tendons, model, k)
    if not disabled & (bits.mjDSBL_CONSTRAINT | bits.mjDSBL_EQUALITY):
        equality = SubElement(root, "equality")
        for k in np.flatnonzero(model.eq_active0).tolist():
            SubElement(equality, *_mjcf_equality(model, k))
    _mjcf_drives(root, model)
    return root


def _mjcf_joint(model: Any, k: int) -> dict[str, str]:
    joint = model.joint(k)
    kind = _JOINTS[int(joint.type[0])]
    found = {"name": _name(model, "joint", k), "type": kind}
    if kind != "free":
        found |= {"pos": _row(joint.pos), "frictionloss": _row(joint.frictionloss[:1])}
        found |= {
            "armature": _row(joint.armature[:1]),
            "damping": _row(joint.damping[:1]),
        }
    if kind in ("slide", "hinge"):
        found |= {
            "axis": _row(joint.axis),
            "stiffness": _row(joint.stiffness[:1]),
            "ref": _row(joint.qpos0),
        }
        if model.jnt_limited[k]:
            found["range"] = _row(joint.range)
    return found


def _add_fixed_tendon(tendons: Element, model: Any, k: int) -> None:
    """A tendon whose length is a sum of joints; others couple no joints."""
    of_joint = import_mujoco().mjtWrap.mjWRAP_JOINT
    path = range(
        int(model.tendon_adr[k]), int(model.tendon_adr[k] + model.tendon_num[k])
    )
    if all(model.wrap_type[i] == of_joint for i in path):
        fixed = SubElement(tendons, "fixed", name=_name(model, "tendon", k))
        for i in path:
            joint = _name(model, "joint", int(model.wrap_objid[i]))
            SubElement(fixed, "joint", joint=joint, coef=_row(model.wrap_prm[i]))


def _mjcf_equality(model: Any, k: int) -> tuple[str, dict[str, str]]:
    kind, data = int(model.eq_type[k]), model.eq_data[k]
    if kind >= len(_EQUALITIES):
        raise InputError(
            f"of equality constraints only {', '.join(_EQUALITIES)} are supported"
        )
    tag = _EQUALITIES[kind]
    if tag in ("joint", "tendon"):
        of = tag
    else:
        of = (
            "site"
            if model.eq_objtype[k] == import_mujoco().mjtObj.mjOBJ_SITE
            else "body"
        )
    ends = (int(model.eq_obj1id[k]), int(model.eq_obj2id[k]))
    found = {
        f"{of}{n}": _name(model, of, end) for n, end in enumerate(ends, 1) if end >= 0
    }
    found |= {"name": name} if (name := model.equality(k).name) else {}
    if of == tag:
        found["polycoef"] = _row(data[:5])
    if of == "body":
        found["anchor"] = _row(data[:3])
    if tag == "weld":
        found["torquescale"] = _row(data[10])
    return tag, found | (
        {"relpose": _row(data[3:10])} if tag == "weld" and of == "body" else {}
    )


def _mjcf_drives(root: Element, model: Any) -> None:
    """Actuators of joints, and sensors of forces."""
    mujoco = import_mujoco()
    actuators, sensors = SubElement(root, "actuator"), SubElement(root, "sensor")
    driving = np.isin(
        model.actuator_trntype,
        (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT),
    )
    for k in np.flatnonzero(driving).tolist():
        driven = {
            "joint": _name(model, "joint", int(model.actuator_trnid[k, 0])),
            "gear": _row(model.actuator_gear[k]),
        }
        SubElement(
            actuators, "general", {"name": _name(model, "actuator", k), **driven}
        )
    for k in range(model.nsensor):
        tag, of = _SENSORS.get(
            mujoco.mjtSensor(int(model.sensor_type[k])).name, ("", "")
        )
        at, name = int(model.sensor_objid[k]), model.sensor(k).name
        if tag and (of != "actuator" or driving[at]):
            SubElement(
                sensors,
                tag,
                {of: _name(model, of, at)} | ({"name": name} if name else {}),
            )


def _name(model: Any, kind: str, k: int) -> str:
    return str(getattr(model, kind)(k).name or f"{kind}{k}")


def _row(numbers: Any) -> str:
    return " ".join(map(repr, np.asarray(numbers, dtype=float).ravel().tolist()))


# -- Pinocchio ---------------------------------------------------------------------------------------------------------


def _urdf(model: Any) -> Element:
    """A model with a link per joint, which carries what is fixed to it; gravity and armatures are not in URDF."""
    root = Element("robot", name=model.name or "robot")
    if not np.array_equal(model.gravity.linear, model.gravity981):
        SubElement(root, "gravity", xyz=_row(model.gravity.linear))
    SubElement(root, "link", name="universe")
    for k in range(1, model.njoints):
        name, inertia = model.names[k], model.inertias[k]
        link = SubElement(root, "link", name=f"{name}_link")
        if inertia.mass or inertia.inertia.any():
            inertial = SubElement(link, "inertial")
            SubElement(inertial, "origin", xyz=_row(inertia.lever))
            SubElement(inertial, "mass", value=repr(float(inertia.mass)))
            upper = [(i, j) for i in range(3) for j in range(i, 3)]
            moments = {
                f"i{'xyz'[i]}{'xyz'[j]}": repr(float(inertia.inertia[i, j]))
                for i, j in upper
            }
            SubElement(inertial, "inertia", moments)
        joint = SubElement(root, "joint", name=name)
        parent = model.parents[k]
        SubElement(
            joint,
            "parent",
            link=f"{model.names[parent]}_link" if parent else "universe",
        )
        SubElement(joint, "child", link=f"{name}_link")
        placed = model.jointPlacements[k]
        SubElement(
            joint,
            "origin",
            xyz=_row(placed.translation),
            rpy=_row(roll_pitch_yaw(np.asarray(placed.rotation))),
        )
        _urdf_motion(joint, model, k)
    return root


def _urdf_motion(joint: Element, model: Any, k: int) -> None:
    about, q, v = model.joints[k], model.joints[k].idx_q, model.joints[k].idx_v
    kind = about.shortname().removeprefix("JointModel")
    if kind == "FreeFlyer":
        joint.set("type", "floating")
        return
    sliding = kind.startswith("P")
    if not _ONE_AXIS.fullmatch(kind):
        problem = f"joints of Pinocchio's type {kind} are not read: pass the URDF or MJCF file of the model"
        raise InputError(problem, element=f"joint '{model.names[k]}'")
    unbounded = "UB" in kind or "Unbounded" in kind
    joint.set(
        "type", "prismatic" if sliding else "continuous" if unbounded else "revolute"
    )
    subspace = np.ravel(about.createData().S)  # not all types state their axis
    SubElement(joint, "axis", xyz=_row(subspace[:3] if sliding else subspace[3:]))
    drive = {
        "damping": model.damping,
        "friction": model.friction,
        "armature": model.armature,
    }
    SubElement(
        joint,
        "dynamics",
        {name: _row(values[v]) for name, values in drive.items() if values[v]},
    )
    if not unbounded:
        limits = {
            "lower": model.lowerPositionLimit[q],
            "upper": model.upperPositionLimit[q],
        }
        limits |= {"effort": model.effortLimit[v], "velocity": model.velocityLimit[v]}
        SubElement(
            joint, "limit", {name: _row(value) for name, value in limits.items()}
        )
