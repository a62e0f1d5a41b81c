"""Platforms carried by several legs, as MJCF files."""

from __future__ import annotations

from support.zoo.case import Case
from support.zoo.mjcf_text import mjcf


def stewart() -> str:
    """A Gough-Stewart platform whose legs slide along their own directions; the file's numbers are decimals."""
    base = [
        (0.58, 0.16),
        (-0.15, 0.58),
        (-0.43, 0.42),
        (-0.44, -0.41),
        (-0.14, -0.59),
        (0.57, -0.18),
    ]
    top = [
        (0.27, 0.14),
        (0.03, 0.31),
        (-0.29, 0.12),
        (-0.28, -0.13),
        (0.02, -0.3),
        (0.26, -0.16),
    ]
    world, equality = (
        '<body name="platform" pos="0 0 0.7"><freejoint name="platform"/>INERTIA</body>',
        "",
    )
    for k, ((x, y), (u, v)) in enumerate(zip(base, top, strict=True), 1):
        along = f"{u - x:.2f} {v - y:.2f} 0.7"
        world += f"""<body name="leg{k}" pos="{x} {y} 0"><joint name="x{k}" axis="1 0 0"/>
          <joint name="y{k}" axis="0 1 0"/>INERTIA<body name="rod{k}">
          <joint name="slide{k}" type="slide" axis="{along}"/>INERTIA</body></body>"""
        equality += f'<connect body1="rod{k}" body2="platform" anchor="{along}"/>'
    return mjcf(world, equality, "slide1 slide2 slide3 slide4 slide5 slide6")


def delta() -> str:
    """A Delta robot: three arms, six rods with balls at both ends, each free to spin."""
    world, equality = (
        '<body name="platform" pos="0 0 -0.4"><freejoint name="platform"/>INERTIA</body>',
        "",
    )
    for k in (1, 2, 3):
        rods = ""
        for side, y in (("l", 0.05), ("r", -0.05)):
            rods += f'<body name="{side}{k}" pos="0.2 {y} 0"><joint name="b{side}{k}" type="ball"/>INERTIA</body>'
            equality += (
                f'<connect body1="{side}{k}" body2="platform" anchor="-0.3 0 -0.4"/>'
            )
        world += f"""<frame euler="0 0 {120 * (k - 1)}"><body name="arm{k}" pos="0.15 0 0">
          <joint name="arm{k}" axis="0 1 0"/>INERTIA{rods}</body></frame>"""
    return mjcf(world, equality, "arm1 arm2 arm3")


PLATFORMS = {
    "stewart mjcf": Case(6, 82, stewart()),
    "delta mjcf": Case(9, 55, delta()),
}
