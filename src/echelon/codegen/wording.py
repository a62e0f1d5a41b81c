"""Names and text from files, made safe for source code: identifiers and comments."""

from __future__ import annotations

import re

from echelon.errors import InputError, one_line

# words that a language reserves, or that name a library which the generated code itself uses
_WORDS = """
abstract alignas alignof and and_eq as asm async auto await base baremodule become begin bitand bitor bool box
break case casadi catch char class classdef compl complex concept const constexpr continue core crate cuda def
default del delete do double dyn elif else elseif end enum error except explicit export extern false final finally
float fn for foreach friend from function global goto if impl import in inline int is jax lambda let local long
loop macro main match math mod module move mut mutable namespace new none nonlocal not numpy operator or otherwise
override parfor pass persistent pi priv private protected pub public quote raise ref register return self short
signed sizeof spmd static std string struct super switch template test this throw trait true try type typedef
typeid typename typeof union unsafe unsigned unsized use using var virtual void volatile where while with xor yield
"""
_TAKEN = frozenset(_WORDS.split())
_LONGEST = 48


def identifier(text: str) -> str:
    r"""A name that is an identifier in every target language, in lower case.

    >>> identifier("UR10 (e-series)"), identifier("3R"), identifier("*/ system(\"x\")"), identifier("class")
    ('ur10_e_series', 'robot_3r', 'system_x', 'class_robot')
    """
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:_LONGEST].strip("_")
    if not name or name[0].isdigit():
        name = f"robot_{name}".strip("_")
    return f"{name}_robot" if name in _TAKEN else name


def checked_identifier(text: str) -> str:
    """A name that a user chose."""
    simple = re.fullmatch(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", text)
    if not simple or text.lower() in _TAKEN or len(text) > 2 * _LONGEST:
        raise InputError(
            f"'{one_line(text)}' cannot be used as a name: letters, digits and single underscores, starting with a "
            "letter, and no word that one of the target languages reserves"
        )
    return text


def comment_text(text: str) -> str:
    r"""Text for a comment, in one line and unable to end the comment in any target language.

    >>> comment_text("a */ system(\"x\")\nb \\")
    'a * / system("x") b /'
    """
    line = one_line(text).replace("\\", "/")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", line).rstrip()


_ASCII = str.maketrans({"·": "*", "²": "^2", "³": "^3", "−": "-"})


def unit_text(unit: str) -> str:
    """A unit in ASCII: ``kg*m^2``."""
    return unit.translate(_ASCII)
