"""The symbols of a description: which names are possible, what values they have, and how they may be used."""

from __future__ import annotations

import keyword
import math
import re
import unicodedata
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from echelon.exact.angle import STEPS_PER_HALF_TURN
from echelon.exact.expressions import PI, RESERVED, parse_angle
from echelon.exact.polynomial import Polynomial, is_trigonometric, symbol_of
from echelon.formats.description_expressions import Expressions
from echelon.formats.description_text import Document
from echelon.formats.intent import Intent
from echelon.formats.options import ReadingOptions, gravity_vector
from echelon.mechanism.mechanism import Mechanism, Symbol, setup_expressions
from echelon.mechanism.placement import ORIGIN, Placement, Vector
from echelon.mechanism.reading import Snap
from echelon.mechanism.roles import symbol_roles

if TYPE_CHECKING:
    from echelon.formats.schema import RobotDescription

GENERIC = gravity_vector("generic", ORIGIN)
"""Gravity of unknown direction; its symbols need no declaration."""


def declared_symbols(robot: RobotDescription, document: Document) -> tuple[dict[str, Symbol], frozenset[str]]:
    """The declared symbols."""
    expressions = Expressions(document, ReadingOptions(), (), {})
    symbols, bare = {}, set()
    for name, entry in robot.symbols.items():
        path = f"symbols.{name}"
        problem = _unusable(name)
        if problem:
            raise document.error(path, f"'{name}' {problem}")
        stated = entry if entry is None or isinstance(entry, str) else entry.value
        value = None if stated is None else _constant(expressions, stated, path)
        meaning = ""
        if entry is not None and not isinstance(entry, str):
            meaning = entry.meaning
            if entry.approximate is not None:
                value = expressions.real(entry.approximate, f"{path}.approximate")
            if value is None and not meaning:
                bare.add(name)
        symbols[name] = Symbol(name, value, stated, meaning)
    return symbols, frozenset(bare)


def _unusable(name: str) -> str:
    """Why a name cannot be a symbol, or nothing."""
    if name in RESERVED:
        return f"has a fixed meaning in expressions and cannot be a symbol ({', '.join(sorted(RESERVED))} have)"
    if keyword.iskeyword(name):
        return f"is a word of the expression language (a Python keyword): use another name, such as {name}_ or {name}1"
    if not name.isidentifier():
        return "is not a possible symbol: letters, digits and _ only, not beginning with a digit, such as l1 or d_4"
    if unicodedata.normalize("NFKC", name) != name:
        return f"is written with compatibility characters: write {unicodedata.normalize('NFKC', name)}"
    if any(c.isdigit() and not c.isascii() for c in name):
        return "is written with other digits than 0 to 9"
    return ""


def _constant(expressions: Expressions, text: str, path: str) -> float:
    value = expressions.parsed(text, path)
    if not set(value.generators()) <= {PI}:
        problem = f"'{text}' is not a number: a relation between symbols belongs where the length or angle is used"
        raise expressions.error(path, problem)
    return value.evaluate({PI: math.pi}, float)


def with_intended_angles(mechanism: Mechanism, intent: Intent) -> Mechanism:
    """Decimal values of angle symbols that are near a multiple of 15° are that multiple; near zero they are meant."""
    found = dict(mechanism.symbols)
    for name in sorted(symbol_roles(mechanism).angles & found.keys()):
        symbol, element = found[name], f"symbols.{name}"
        if symbol.exact is None or symbol.value is None or parse_angle(symbol.exact).half_turns:
            continue
        steps = round(intent.angle_value(symbol.value, element) * STEPS_PER_HALF_TURN / math.pi)
        exact = steps * math.pi / STEPS_PER_HALF_TURN
        difference = abs(symbol.value - exact)
        if steps and difference <= intent.angle_tolerance(element):
            intent.snaps.append(Snap(element, symbol.exact, f"{15 * steps}°", difference))
            found[name] = replace(symbol, value=exact, exact=f"{steps}*pi/{STEPS_PER_HALF_TURN}")
    return replace(mechanism, symbols=found)


def check_use(mechanism: Mechanism, robot: RobotDescription, document: Document) -> list[str]:
    """Check that every symbol has one role."""
    geometry = {generator for entry in _geometry(mechanism) for generator in entry.generators()}
    gravity = {generator for entry in mechanism.gravity or () for generator in entry.generators()}
    plain = {g for g in geometry | gravity if not is_trigonometric(g)}
    for generator in geometry | gravity:
        if is_trigonometric(generator) and symbol_of(generator) in plain:
            name = symbol_of(generator)
            raise document.error(f"symbols.{name}", f"'{name}' is used as an angle and as another quantity")
    if mechanism.gravity is not None and mechanism.gravity == GENERIC:
        for name in sorted(gravity & geometry):
            raise document.error(
                f"symbols.{name}", f"'{name}' is a component of the generic gravity: rename the symbol"
            )
    terms = " ".join(action.term for effect in mechanism.effects for action in effect.actions)
    used = {symbol_of(g) for g in geometry | gravity} | set(re.findall(r"\w+", terms))
    unused = [name for name in robot.symbols if name not in used]
    put_in = [name for name in unused if name not in mechanism.symbols and robot.symbols[name] is not None]
    return [
        f"the symbol '{name}' is taken at its value everywhere, as loops need ratios that are numbers"
        if name in put_in
        else f"the symbol '{name}' is not used"
        for name in unused
    ]


def _geometry(mechanism: Mechanism) -> Iterator[Polynomial]:
    for body in mechanism.bodies:
        for step in body.joint.steps:
            if isinstance(step, Placement):
                yield from step.translation
                yield from (entry for row in step.rotation for entry in row)
            else:
                yield step.pitch
    yield from setup_expressions(mechanism)


def stated_gravity(robot: RobotDescription, expressions: Expressions) -> Vector | None:
    """Gravity as the description states it; None for none."""
    if robot.gravity == "none":
        return None
    if robot.gravity == "generic":
        return GENERIC
    assert not isinstance(robot.gravity, str)
    return expressions.vector(robot.gravity, "gravity")
