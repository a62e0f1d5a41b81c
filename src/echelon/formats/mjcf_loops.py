"""Loops of MJCF: the equality constraints ``connect`` and ``weld``, between bodies or between sites.

Between bodies, ``connect`` states its point on the first body and ``weld`` on the second.  The other body has it where
it is at the reference pose, unless a weld states the relative pose.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

from echelon.formats.literal import LiteralClosure, LiteralFrame, LiteralPlacement
from echelon.formats.mjcf_equality import equality_kind, equality_label
from echelon.formats.mjcf_numbers import exact_triple, placements
from echelon.formats.mjcf_spec import import_mujoco
from echelon.mechanism.closure import ClosureKind

_ANCHOR, _POSITION, _QUATERNION, _TORQUE_SCALE = slice(0, 3), slice(3, 6), slice(6, 10), 10
_BALL = ("w", "x", "y", "z")


def driven_joints(spec: Any) -> tuple[str, ...]:
    """Names of the joints that actuators drive directly."""
    transmissions = import_mujoco().mjtTrn
    direct = (transmissions.mjTRN_JOINT, transmissions.mjTRN_JOINTINPARENT)
    return tuple(dict.fromkeys(str(a.target) for a in spec.actuators if a.trntype in direct))


def read_poses(model: Any, keyframes: Mapping[str, Sequence[float]]) -> dict[str, dict[str, float]]:
    """The coordinates of the reference pose, and of the keyframes, by what states them."""
    names: list[str] = []
    for index in range(model.njnt):
        joint = model.joint(index)
        ball = tuple(f"{joint.name}.{c}" for c in _BALL)
        free = (*(f"{joint.name}.t{c}" for c in "xyz"), *(f"{joint.name}.r.{c}" for c in _BALL))
        names += {1: (str(joint.name),), len(ball): ball, len(free): free}[len(joint.qpos0)]
    stated = {"the reference pose": model.qpos0} | {f"keyframe '{name}'": qpos for name, qpos in keyframes.items()}
    # a rotation without w would be taken for none
    return {
        element: {n: float(v) for n, v in zip(names, qpos, strict=True) if v or n.endswith(".w")}
        for element, qpos in stated.items()
        if len(qpos) == len(names) and all(map(isfinite, qpos))
    }


def read_keyframes(spec: Any) -> dict[str, Sequence[float]]:
    """Positions of the keyframes, by name or number."""
    return {str(key.name) or str(number): list(key.qpos) for number, key in enumerate(spec.keys)}


def read_closures(equalities: Sequence[Any], model: Any, spec: Any) -> Iterator[LiteralClosure]:
    """The closures of a compiled model."""
    sites = {site.name: site for site in spec.sites}
    taken = {equality.name for equality in equalities}
    for number, equality in enumerate(equalities, 1):
        kind, label = _kind(equality), equality_label(equality)
        name = str(equality.name) or _unused(f"loop{number}", taken)
        if equality.objtype == import_mujoco().mjtObj.mjOBJ_SITE:
            (first, at), (second, on_second) = (
                site_frame(model, sites[str(site)], label) for site in (equality.name1, equality.name2)
            )
            yield LiteralClosure(label, name, kind, first, second, at, on_second)
        else:
            yield _between_bodies(equality, model, label, name, kind)


def _unused(name: str, taken: Collection[str]) -> str:
    while name in taken:
        name += "_"
    return name


def _kind(equality: Any) -> ClosureKind:
    # a weld that does not count rotations is a connect
    rigid = equality_kind(equality) == "weld" and equality.data[_TORQUE_SCALE]
    return ClosureKind.WELD if rigid else ClosureKind.SPHERICAL


def site_frame(model: Any, site: Any, label: str) -> tuple[int, tuple[LiteralPlacement, ...]]:
    """The body that carries a site, and the site's frame on it."""
    compiled = model.site(site.name)
    xyz = exact_triple(compiled.pos, site.pos)
    return int(compiled.bodyid[0]), placements(f"{label} site '{site.name}'", xyz, compiled.quat)


def named_frames(model: Any, spec: Any) -> Iterator[LiteralFrame]:
    """The sites that have names."""
    for site in spec.sites:
        if site.name:
            body, at = site_frame(model, site, "frame")
            yield LiteralFrame(str(site.name), body, at)


def _between_bodies(equality: Any, model: Any, label: str, name: str, kind: ClosureKind) -> LiteralClosure:
    stated, other = (_body(model, body) for body in (equality.name1, equality.name2))
    related = None
    if equality_kind(equality) == "weld":
        stated, other = other, stated
        if any(equality.data[_QUATERNION]):
            related = placements(f"{label} pose", exact_triple(equality.data[_POSITION]), equality.data[_QUATERNION])
    anchor = LiteralPlacement(f"{label} anchor", exact_triple(equality.data[_ANCHOR]))
    return LiteralClosure(label, name, kind, stated, other, (anchor,), related)


def _body(model: Any, name: str) -> int:
    """Index of a body; the second one may be left out and is the world then."""
    return int(model.body(name).id) if name else 0
