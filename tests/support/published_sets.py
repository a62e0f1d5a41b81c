"""A published set of base parameters, and models that claims are held against."""

from __future__ import annotations

from functools import cache

import echelon as ec
from support.paths import EXAMPLES

RX90_FILE = str(EXAMPLES / "rx90.yaml")

RX90 = """
ZZR1 = ZZ1 + YY2 + YY3 + D3^2*(M3+M4+M5+M6)
XXR2 = XX2 - YY2 - D3^2*(M3+M4+M5+M6)
XY2
XZR2 = XZ2 - D3*MZ3
YZ2
ZZR2 = ZZ2 + D3^2*(M3+M4+M5+M6)
MXR2 = MX2 + D3*(M3+M4+M5+M6)
MY2
XXR3 = XX3 - YY3 + YY4 + 2*RL4*MZ4 + RL4^2*(M4+M5+M6)
XY3
XZ3
YZ3
ZZR3 = ZZ3 + YY4 + 2*RL4*MZ4 + RL4^2*(M4+M5+M6)
MX3
MYR3 = MY3 + MZ4 + RL4*(M4+M5+M6)
XXR4 = XX4 - YY4 + YY5
XY4
XZ4
YZ4
ZZR4 = ZZ4 + YY5
MX4
MYR4 = MY4 - MZ5
XXR5 = XX5 - YY5 + YY6
XY5
XZ5
YZ5
ZZR5 = ZZ5 + YY6
MX5
MYR5 = MY5 + MZ6
XXR6 = XX6 - YY6
XY6
XZ6
YZ6
ZZ6
MX6
MY6
"""
"""Khalil & Dombre, "Modeling, Identification and Control of Robots" (2002), table 9.3, masses spelled out."""


@cache
def base(file: str) -> ec.BaseModel:
    return ec.base_parameters(ec.load(file))


def rows(text: str = RX90) -> list[str]:
    return [
        line.partition("=")[2].strip() or line.strip()
        for line in text.strip().splitlines()
    ]
