"""The picture of an elastic drive: motor, gear, spring and damper, link, with encoders and torques where they are."""

from __future__ import annotations

WIDTH, HEIGHT, AXIS = 760, 230, 120
"""Size of the picture, and height of the axis that all parts turn about, px."""
MOTOR, GEAR, LINK = 90, 250, 560
"""Places of motor and gear, and where the link begins, px."""
SPRING = (330, 500)  # ends of the spring, px
TURNS, LIFT = 9, 14  # of the spring: turns, and half of its height in px
MEASURED, HIDDEN = "#1b6ca8", "#b5532a"
"""Colours of what is measured, and of what is found from it."""


def box(left: int, top: int, width: int, height: int, text: str) -> list[str]:
    """A part with its name below."""
    return [
        f'<rect x="{left}" y="{top}" width="{width}" height="{height}" rx="5" fill="#f4f4f1" stroke="#555"/>',
        words(left + width // 2, AXIS + 62, text),
    ]


def words(place: int, height: int, text: str, colour: str = "#222") -> str:
    """A text about a place."""
    return f'<text x="{place}" y="{height}" text-anchor="middle" fill="{colour}">{text}</text>'


def spring() -> str:
    """The spring, above the axis, and the damper below."""
    left, right = SPRING
    step = (right - left) / (TURNS + 1)
    points = [f"{left},{AXIS - 22}"]
    for k in range(TURNS):
        height = AXIS - 22 + (LIFT if k % 2 else -LIFT)
        points.append(f"{left + step * (k + 1):.0f},{height}")
    points.append(f"{right},{AXIS - 22}")
    middle = (left + right) // 2
    damper = (
        f"M{left} {AXIS + 22}H{middle + 4}M{middle + 4} {AXIS + 12}V{AXIS + 32}"
        f"M{middle + 24} {AXIS + 8}H{middle - 14}V{AXIS + 36}H{middle + 24}M{middle - 14} {AXIS + 22}"
        f"M{middle + 24} {AXIS + 22}H{right}"
    )
    return (
        f'<polyline points="{" ".join(points)}" fill="none" stroke="#555" stroke-width="2"/>\n'
        f'<path d="{damper}" fill="none" stroke="#555" stroke-width="2"/>'
    )


def shaft(begin: int, end: int) -> str:
    """A piece of the shaft."""
    return f'<path d="M{begin} {AXIS}H{end}" stroke="#555" stroke-width="4"/>'


def plate(place: int) -> str:
    """An end of spring and damper."""
    return (
        f'<path d="M{place} {AXIS - 40}V{AXIS + 40}" stroke="#555" stroke-width="4"/>'
    )


def picture() -> str:
    """The picture as SVG."""
    left, right = SPRING
    drawn = [
        *box(MOTOR - 40, AXIS - 35, 80, 70, "motor, ZZ_m1"),
        *box(GEAR - 25, AXIS - 45, 50, 90, "gear, 100 : 1"),
        *box(LINK, AXIS - 16, 150, 32, "links, ZZ1, MX1, …"),
        shaft(MOTOR + 40, GEAR - 25),
        shaft(GEAR + 25, left),
        shaft(right, LINK),
        plate(left),
        plate(right),
        spring(),
        words((left + right) // 2, AXIS + 62, "m1.spring: Ks1, Ds1", HIDDEN),
        words(MOTOR, 40, "torque m1, friction Fv1 …", MEASURED),
        words(MOTOR, 60, "encoder m1: θ", MEASURED),
        words(LINK + 75, 60, "encoder j1: q", MEASURED),
        words((left + right) // 2, 40, "force: zero with that of the links", HIDDEN),
        words((left + right) // 2, 60, "deflection q − θ/100", HIDDEN),
    ]
    body = "\n".join(drawn)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" '
        f'font-size="13">\n<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n'
    )
