"""Texts of MJCF models, and how they are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from echelon.formats.builder import build_mechanism
from echelon.formats.literal import LiteralTree
from echelon.formats.mjcf.mjcf_model import checked_mjcf
from echelon.formats.mjcf.mjcf_reader import read_mjcf
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism

INERTIA = (
    '<inertial pos="0.05 -0.02 0.11" mass="1.3" euler="0.2 0.3 -0.4" diaginertia="0.021 0.017 0.012"/>'
    '<geom type="sphere" size="0.01"/>'
)
"""What a body weighs, and a geom that does not matter beside it."""


def read(text: str, directory: Path | None = None, mimics: bool = True) -> LiteralTree:
    return read_mjcf(checked_mjcf(text, "robot.xml", directory), mimics=mimics)


def model(worldbody: str, head: str = "", tail: str = "") -> str:
    return f"<mujoco>{head}<worldbody>{worldbody}</worldbody>{tail}</mujoco>"


def mechanism_of(tree: LiteralTree) -> Mechanism:
    return build_mechanism(tree, ReadingOptions(snap_tolerance=0)).mechanism


# -- random models with equality constraints ---------------------------------------------------------------------------

_KINDS = ("hinge", "hinge", "hinge", "slide", "ball")
_DEFAULTS = """<compiler angle="radian"/><default><joint axis="0 1 0"/><equality solref="0.01 1"/>
<default class="off"><equality active="false"/></default></default>"""


def random_tree(rng: np.random.Generator, bodies: int = 6) -> tuple[str, list[str]]:
    """Bodies on bodies, some with two joints, one free and some fixed, each with a site; and the single-axis joints."""
    children: dict[int, list[int]] = {k: [] for k in range(-1, bodies)}
    for k in range(bodies):
        children[int(rng.integers(-1, k)) if k else -1].append(k)
    scalar: list[str] = []

    def numbers(count: int, spread: float = 0.5) -> str:
        return " ".join(f"{v:.3g}" for v in rng.uniform(-spread, spread, count))

    def joints(k: int, top: bool) -> str:
        kinds = (
            ["free"] if top and k and rng.random() < 0.3 else [str(rng.choice(_KINDS))]
        )
        kinds = (
            []
            if k == bodies - 1
            else [*kinds, "hinge"]
            if kinds == ["hinge"] and rng.random() < 0.3
            else kinds
        )
        text = ""
        for i, kind in enumerate(kinds):
            place = "" if kind == "free" else f' pos="{numbers(3, 0.2)}"'
            axis = (
                f' axis="{numbers(3)}" ref="{numbers(1)}"'
                if kind in ("hinge", "slide") and k
                else ""
            )
            text += f'<joint name="j{k}_{i}" type="{kind}"{place}{axis}/>'
            scalar.extend([f"j{k}_{i}"] if kind in ("hinge", "slide") else [])
        return text

    def body(k: int, top: bool) -> str:
        inner = "".join(body(child, False) for child in children[k])
        site = f'<site name="s{k}" pos="{numbers(3)}" euler="{numbers(3, 2)}"/>'
        place = f'name="b{k}" pos="{numbers(3)}" euler="{numbers(3, 2)}"'
        return f"<body {place}>{joints(k, top)}{INERTIA}{site}{inner}</body>"

    return '<site name="home"/>' + "".join(body(k, True) for k in children[-1]), scalar


def random_equalities(
    rng: np.random.Generator, bodies: int, scalar: list[str], loops: bool
) -> tuple[str, str]:
    """Tendons, and constraints of all kinds; some twice, some inactive by a class or by themselves.

    Where there are no loops, joints follow others by polynomials.
    """
    found: list[str] = []
    one, two = (int(k) for k in rng.choice(bodies, 2, replace=False))
    anchor = " ".join(f"{v:.3g}" for v in rng.uniform(-0.3, 0.3, 3))
    found.append(
        str(
            rng.choice(
                [
                    f'<connect body1="b{one}" body2="b{two}" anchor="{anchor}"/>',
                    f'<connect body1="b{one}" anchor="{anchor}"/>',
                    f'<connect site1="s{one}" site2="s{two}"/>',
                    f'<weld body1="b{one}" body2="b{two}" anchor="{anchor}"/>',
                    f'<weld body1="b{one}" body2="b{two}" anchor="{anchor}" torquescale="0"/>',
                ]
            )
        )
    )
    found = found * int(rng.integers(1, 3)) if loops else []
    found.append(
        f'<weld class="off" body1="b{one}"/><connect active="false" body1="b{two}" anchor="0 0 0"/>'
    )
    names = [str(name) for name in rng.permutation(scalar)]
    tendons = ""
    if len(names) > 1:
        poly = " ".join(
            f"{v:.2g}"
            for v in [
                rng.uniform(-0.2, 0.2),
                rng.uniform(0.5, 2),
                *rng.uniform(-0.3, 0.3, 3) * (not loops),
            ]
        )
        found.append(
            f'<joint joint1="{names[0]}" joint2="{names[1]}" polycoef="{poly}"/>'
        )
    if len(names) > 4:
        parts = [
            f'<joint joint="{n}" coef="{c:.2g}"/>'
            for n, c in zip(names[1:4], rng.uniform(0.5, 2, 3), strict=True)
        ]
        tendons = f'<fixed name="t1">{"".join(parts[:2])}</fixed><fixed name="t2">{parts[2]}</fixed>'
        found.append('<tendon tendon1="t1" tendon2="t2" polycoef="0.1 0.7 0 0 0"/>')
    if len(names) > 5 and rng.random() < 0.5:
        found.append(f'<joint joint1="{names[5]}" polycoef="0.1 0 0 0 0"/>')
    return tendons, "".join(found)


def random_model(seed: int, loops: bool, bodies: int = 6) -> str:
    """A tree with constraints, most of which leave it some motion."""
    rng = np.random.default_rng(seed)
    tree, scalar = random_tree(rng, bodies)
    tendons, equalities = random_equalities(rng, bodies, scalar, loops)
    return model(
        tree, _DEFAULTS, f"<tendon>{tendons}</tendon><equality>{equalities}</equality>"
    )
