"""How other programs write the standard parameters, as one table.

A naming is a list of patterns; with the labels and names of a model's bodies they give the vocabulary, all texts that
stand for a parameter of this model.  Sources: SYMORO's `.par` and `.dyn` files (Khalil & Creusot 1997), SymPyBotics'
`dynparms`, and FIGAROH's `params_std`, which follows Pinocchio's `toDynamicParameters`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from echelon.base.model import BaseModel
from echelon.claims.linear_terms import names_in
from echelon.conventions import PARAMETERS
from echelon.errors import InputError

AUTO = "auto"


@dataclass(frozen=True)
class Naming:
    """One program's way of writing standard parameters."""

    name: str
    inertial: tuple[tuple[str, ...], ...]  # patterns of XX … M; ``{}`` stands for a body's label, name, or joint
    effects: Mapping[str, tuple[str, ...]]  # patterns of the usual drive parameters by their kind here: Ia, Fv, Fc, Fo


def _spelled(kinds: str) -> tuple[tuple[str, ...], ...]:
    """Patterns from space-separated kinds: with and without an underscore before the body."""
    return tuple((kind + "{}", kind + "_{}") for kind in kinds.split())


def _patterns(texts: str) -> tuple[tuple[str, ...], ...]:
    return tuple((text,) for text in texts.split())


NAMINGS: tuple[Naming, ...] = (
    Naming(
        "echelon",
        _spelled("XX XY XZ YY YZ ZZ MX MY MZ M"),
        {"Ia": ("Ia{}",), "Fv": ("Fv{}",), "Fc": ("Fc{}",), "Fo": ("Fo{}",)},
    ),
    Naming(
        "symoro",
        _spelled("XX XY XZ YY YZ ZZ MX MY MZ M"),
        {"Ia": ("IA{}",), "Fv": ("FV{}",), "Fc": ("FS{}",), "Fo": ("FO{}", "OFF{}")},
    ),
    Naming(
        "sympybotics",
        _patterns("L_{}xx L_{}xy L_{}xz L_{}yy L_{}yz L_{}zz l_{}x l_{}y l_{}z m_{}"),
        {"Ia": ("Ia_{}",), "Fv": ("fv_{}",), "Fc": ("fc_{}",), "Fo": ("fo_{}",)},
    ),
    Naming(
        "pinocchio",
        _spelled("Ixx Ixy Ixz Iyy Iyz Izz mx my mz m"),
        {"Ia": ("Ia{}", "Ia_{}"), "Fv": ("fv{}", "fv_{}"), "Fc": ("fs{}", "fs_{}"), "Fo": ("off{}", "off_{}")},
    ),
)

NAMES = tuple(naming.name for naming in NAMINGS)


def vocabulary(naming: Naming, model: BaseModel) -> dict[str, str]:
    """All texts that stand for a standard parameter of a model, with the parameter's own name.

    Bodies go by label, name or joint; a name that two bodies share stands for none.  Parameters that are not inertial
    also go by their own names, whatever the naming.
    """
    words: dict[str, str] = {}
    identifiers, sharing = _identifiers(model), model.mechanism.sharing
    for column in model.mechanism.columns:
        if column.body is not None and column.kind is not None:
            patterns = naming.inertial[column.kind]
            words.update(
                (p.format(i), column.name) for k in sharing[column.body] for i in identifiers[k] for p in patterns
            )
        else:
            words[column.name] = column.name
            found = re.fullmatch(r"(Ia|Fv|Fc|Fo)(.+)", column.name)
            if found:
                words.update((pattern.format(found[2]), column.name) for pattern in naming.effects[found[1]])
    return words


def _identifiers(model: BaseModel) -> list[list[str]]:
    """For every body all texts that stand for it: its label, and its name and joint if no other body has them."""
    bodies = model.mechanism.bodies
    labels = {body.label for body in bodies}
    given = [name for body in bodies for name in {body.name, body.joint.name}]
    return [
        [b.label, *(n for n in sorted({b.name, b.joint.name}) if given.count(n) == 1 and n not in labels)]
        for b in bodies
    ]


def find_naming(texts: Sequence[str], model: BaseModel, wanted: str = AUTO) -> tuple[Naming, dict[str, str]]:
    """The naming that expressions are written in, with its vocabulary."""
    if wanted not in (AUTO, *NAMES):
        raise InputError(f"unknown naming '{wanted}' (valid: {', '.join((AUTO, *NAMES))})")
    candidates = [(n, vocabulary(n, model)) for n in NAMINGS if wanted in (AUTO, n.name)]
    return max(candidates, key=lambda candidate: sum(_known(text, candidate[1]) for text in texts))


def _known(text: str, words: Mapping[str, str]) -> int:
    plain, odd = plain_words(text, words)
    return sum(name in words or name in odd for name in names_in(plain))


def plain_words(text: str, words: Iterable[str]) -> tuple[str, dict[str, str]]:
    """A text whose words are all identifiers, and for every word that was replaced the original.

    Bodies may have names such as ``panda-link1``, which an expression would take for a difference.
    """
    odd = sorted((w for w in words if not w.isidentifier() and w in text), key=len, reverse=True)
    stands_for = {f"word_{k}_": word for k, word in enumerate(odd)}
    for placeholder, word in stands_for.items():
        text = text.replace(word, placeholder)
    return text, stands_for


def unknown_token(token: str, naming: Naming, words: Iterable[str], symbols: Iterable[str]) -> str:
    """What is wrong with a token that is neither a parameter nor a symbol, and what would be valid."""
    valid = [*words, *symbols]
    plain = re.sub(r"^([A-Z]+)R(?=\w)", r"\1", token)
    if plain != token and plain in valid:
        return f"'{token}' is a regrouped parameter, not a standard one: write its expression, such as {plain} + …"
    near = get_close_matches(token, valid, n=4, cutoff=0.5) or sorted(valid)[:4]
    return (
        f"'{token}' is neither a standard parameter in the naming of {naming.name} nor a symbol of the robot "
        f"(nearest: {', '.join(near)}; {len(PARAMETERS)} parameters per body)"
    )
