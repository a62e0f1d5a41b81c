"""The table of exact mechanisms: functions by name, and variants of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from flint import ctx

from support.rounded_exports import legs, parallel, planar, spatial
from support.rounded_exports.geometry import BITS, degrees, rotation, vec
from support.rounded_exports.mechanism import Draft, Exact
from support.rounded_exports.poses import elsewhere

PLANAR: tuple[Callable[[Draft], None], ...] = (
    planar.four_bar, planar.parallelogram, planar.three_cranks, planar.antiparallelogram, planar.kite,
    planar.slider_crank, planar.scott_russell, planar.watt_six_bar, planar.stephenson_six_bar, planar.five_bar,
    planar.scissor_one, planar.scissor_two, planar.scissor_three, planar.two_four_bars, planar.three_four_bars,
    planar.four_four_bars, planar.pantograph_leg, planar.peaucellier, planar.jansen, planar.chebyshev_lambda,
    planar.hoeken, planar.klann, planar.planar_3rrr, planar.planar_3prr, planar.oldham, planar.scotch_yoke,
    planar.quick_return, planar.parallel_gripper, planar.robotiq, planar.excavator, planar.hoberman,
    planar.ackermann, planar.hart, planar.watt_line,
)  # fmt: skip
SPATIAL: tuple[Callable[[Draft], None], ...] = (
    planar.remote_center, planar.palletizer, planar.sr400, spatial.spherical_four_bar, spatial.cardan,
    spatial.agile_eye, spatial.spherical_3rrr, spatial.sarrus, spatial.sarrus_oblique, spatial.bennett,
    spatial.goldberg, spatial.double_cardan, spatial.threefold_bricard, spatial.line_symmetric_bricard,
    spatial.plane_symmetric_bricard, spatial.four_bar_across, spatial.double_wishbone, spatial.rssr,
    spatial.rssr_spin, parallel.delta, parallel.delta_four, parallel.four_legs_in_pairs, parallel.delta_pins,
    parallel.orthoglide, parallel.linear_delta, parallel.three_rps, parallel.gough_stewart,
    parallel.gough_stewart_general, parallel.two_ups_u, parallel.exechon, parallel.three_upu, parallel.hexa,
    legs.ankle_two_rods, legs.ankle_balls, legs.leg_with_rods, legs.biped, legs.digit_leg, legs.kangaroo_leg,
    legs.waist,
)  # fmt: skip
FUNCTIONS = {function.__name__: function for function in (*PLANAR, *SPATIAL)}
TURNS = {"tilted": (vec(1, 2, -0.5), 37), "level": (vec(1, 0, 0), 90)}
"""Variants of the orientation: in a general one, and with planes that are level."""

VARIANTS = (
    "four_bar-tilted", "parallelogram-tilted", "watt_six_bar-tilted", "scissor_two-tilted", "peaucellier-tilted",
    "five_bar-level", "planar_3rrr-level", "bennett-tilted", "sarrus-tilted", "agile_eye-tilted",
    "four_bar-floating", "ankle_two_rods-floating", "biped-floating", "waist-floating", "two_ups_u-floating",
    "delta-moved", "three_rps-moved", "ankle_two_rods-moved", "parallel_gripper-moved", "scissor_two-moved",
    "line_symmetric_bricard-moved", "four_bar-sawn", "scissor_one-sawn", "bennett-sawn", "delta-sawn", "biped-sawn",
    "orthoglide-moved", "palletizer-moved",
)  # fmt: skip
NAMES = (*FUNCTIONS, *VARIANTS)


@cache
def build(name: str) -> Exact:
    """A mechanism of `NAMES`: a function, and what its variants say after dashes."""
    plain, *variants = name.split("-")
    with ctx.workprec(BITS):
        draft = Draft()
        FUNCTIONS[plain](draft)
        parts = tuple(draft.parts)
        exact = Exact(
            name, parts, tuple(draft.closures), planar=FUNCTIONS[plain] in PLANAR
        )
        for variant in variants:
            if variant == "floating":
                exact = replace(exact, floating=True)
            elif variant == "sawn":
                exact = exact.sawn()
            elif variant == "moved":
                exact = elsewhere(exact, np.random.default_rng(len(parts)))
            else:
                axis, angle = TURNS[variant]
                exact = exact.turned(rotation(axis, degrees(angle)))
        return exact
