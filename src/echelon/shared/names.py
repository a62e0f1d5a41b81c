"""Names in robot files and models: a row of a result must not read as another because of what something is called.

Labels, symbols and parameters stand in formulas, such as ``MX1 + l1·M2``, so they are *identifiers*: letters, digits
and ``_``.  Bodies, joints and outputs stand beside formulas and are *titles*: robot files call them ``left/arm``,
``wrist-2`` or ``Arm (left)``, which is fine as long as they are no formula.

Letters are those of living scripts that are written from left to right, composed as Unicode composes them (NFKC, as
Python does with identifiers), and digits are 0 to 9.  All else is refused: characters without width, text that runs
from right to left, symbols such as ``·`` or ``²``.  Letters that look like others (Unicode Technical Standard 39) make
two names read alike, as Latin ``M2`` and Greek ``Μ2`` do.  So a word between two separators is of one script, and one
that is not Latin has a letter that shows it.  Latin letters may only stand beside letters that no one takes for Latin
ones, as in ``关节J1`` or ``Δx``.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterable
from itertools import groupby

from echelon.shared.errors import InputError

_LATIN, _EAST_ASIAN = "Latin", "East Asian"
_SCRIPTS = {
    "LATIN": _LATIN,
    "GREEK": "Greek",
    "CYRILLIC": "Cyrillic",
    "ARMENIAN": "Armenian",
    "GEORGIAN": "Georgian",
    "DEVANAGARI": "Devanagari",
    "THAI": "Thai",
    "CJK": _EAST_ASIAN,
    "IDEOGRAPHIC": _EAST_ASIAN,
    "HIRAGANA": _EAST_ASIAN,
    "KATAKANA": _EAST_ASIAN,
    "HANGUL": _EAST_ASIAN,
}
"""Scripts by the first word of the Unicode names of their letters."""

_LATIN_WITHOUT_ASCII = frozenset(
    "ßẞæÆœŒøØđĐłŁħĦþÞðÐŋŊıəƏ"
)  # letters of living languages that are no letter with marks

_LOOK_ALIKES = str.maketrans(
    # Greek, Cyrillic, Armenian, Latin without a dot, strokes and crosses of East Asia
    "ΑΒΕΖΗΙΚΜΝΟΡΤΥΧοινυАВЕЅІЈКМНОРСТУХҮԚԜӀаеіјорсухѕһԁԛԝѵӏՏՍՕսոօհցզյքı一ー丨丶丿ノ十乂二ニ",
    "ABEZHIKMNOPTYXoivuABESIJKMHOPCTYXYQWIaeijopcyxshdqwvlSUOunohgqjpi--|.//+x==",
)
"""ASCII characters that letters look like; α, γ, ρ and σ do not, as formulas use them beside a, y, p and o."""

_CLEAR_GREEK = frozenset(
    "ΓΔΘΛΞΠΣΦΨΩδθλξπφψω"
)  # may stand beside Latin letters, as in Δx

_SHAPES = str.maketrans(
    "工口力夕八卜三へ", "エロカタハトミヘ"
)  # Chinese and Japanese letters of one shape

_MEANT_LETTERS = "letters, digits and _ are valid, such as 3, l1, D_4, θ1"
_MEANT_TITLE = "letters, digits, blanks and - . / : ( ) are valid, such as 'wrist_2', 'left arm' or '左臂'"
_TITLE_CHARACTERS = " !\"#$%&'()+,-./:;<=>?@[\\]_`{|}~"  # of ASCII all but * and ^, which only formulas hold
_NUMBER = re.compile(r"[0-9.]+")
_WORD = re.compile(r"[^\W_]+")


def check_identifier(name: str, element: str, *, composed: bool = False) -> None:
    """Refuse what cannot stand in a formula: the name of a parameter or symbol, or the label that ends it.

    Parameters
    ----------
    name : str
    element : str
        Where it stands, for the message.
    composed : bool
        Whether a stem such as ``Fv`` or ``px`` may stand before letters of another script.

    Raises
    ------
    InputError
        If it is not made of letters, digits and ``_``, or could be taken for another name.
    """
    if not name:
        raise InputError(f"the name is empty: {_MEANT_LETTERS}", element=element)
    _check_characters(name, element, "_", _MEANT_LETTERS)
    _check_words(name, element, composed)


def check_title(name: str, element: str, symbols: Collection[str] = ()) -> None:
    """Refuse a name of a body, joint or output that could be taken for another, or for a formula.

    Parameters
    ----------
    name : str
    element : str
        Where it stands, for the message.
    symbols : collection of str
        Parameters and symbols that formulas hold.

    Raises
    ------
    InputError
        If it holds other characters than letters, digits and those of ASCII, or is a formula.
    """
    _check_characters(name, element, _TITLE_CHARACTERS, _MEANT_TITLE)
    _check_words(name, element)
    if _is_formula(name, symbols):
        raise InputError(
            f"the name reads as a formula: {_MEANT_TITLE}", element=element
        )


def check_text(text: str, element: str) -> None:
    """Refuse a unit or a remark with characters that cannot be seen, or that turn the direction of writing."""
    for character in text:
        if (
            not character.isprintable()
            or _is_hidden(character)
            or _runs_leftwards(character)
        ):
            raise InputError(
                f"holds {_shown(character)}: characters that can be seen are valid",
                element=element,
            )


def check_distinct(names: Iterable[str], what: str) -> None:
    """Refuse different names that look the same.

    Parameters
    ----------
    names : iterable of str
    what : str
        What they name, in the plural.

    Raises
    ------
    InputError
        If two look the same; names both, and what makes the difference.

    Examples
    --------
    >>> check_distinct(["M2", "Μ2"], "symbols")
    Traceback (most recent call last):
        ...
    echelon.shared.errors.InputError: symbols 'M2' and 'Μ2' look the same: U+039C (GREEK CAPITAL LETTER MU) makes
    them differ
    """
    seen: dict[str, str] = {}
    for name in names:
        first = seen.setdefault(skeleton(name), name)
        if first != name:
            odd = next((c for c in (*name, *first) if not c.isascii()), " ")
            raise InputError(
                f"{what} '{first}' and '{name}' look the same: {_shown(odd)} makes them differ"
            )


def skeleton(name: str) -> str:
    """Skeleton of a name, which names that look the same share.

    >>> skeleton("Μ2"), skeleton("left  arm"), skeleton("α2")
    ('M2', 'left arm', 'α2')
    """
    if name.isascii():
        return " ".join(name.split())
    parted = (
        unicodedata.normalize("NFKD", name).translate(_SHAPES).translate(_LOOK_ALIKES)
    )
    return " ".join(unicodedata.normalize("NFC", parted).split())


def symbol_stem(name: str) -> str:
    """The ending of the names of symbols and parameters that belong to a part, joint or loop of this name.

    >>> symbol_stem("left-knee")
    '_left_knee'
    """
    plain = (
        unicodedata.normalize("NFKC", c) == c and (c.isascii() or not c.isdigit())
        for c in name
    )
    return "_" + "".join(
        c if fits and f"_{c}".isidentifier() else "_"
        for c, fits in zip(name, plain, strict=True)
    )


def _check_characters(name: str, element: str, others: str, meant: str) -> None:
    """Refuse all but letters, digits 0 to 9, and others of ASCII."""
    composition = unicodedata.normalize("NFKC", name)
    for character in composition:
        usual = (
            character.isalnum() or character in others
            if character.isascii()
            else _script(character)
        )
        if not usual:
            raise InputError(
                f"the name holds {_shown(character)}: {meant}", element=element
            )
    if composition != name:
        raise InputError(
            f"the name has unusual forms of characters: write '{composition}'",
            element=element,
        )


def _check_words(name: str, element: str, composed: bool = False) -> None:
    for word in () if name.isascii() else _WORD.findall(name):
        problem = _word_problem(word, composed)
        if problem:
            raise InputError(f"the name {problem}", element=element)


def _word_problem(word: str, composed: bool) -> str:
    """Why a word may be read as another, or nothing."""
    runs = [(_script(run), run) for run in _runs(word)]
    scripts = list(dict.fromkeys(script for script, _ in runs))
    foreign = "".join(run for script, run in runs if script != _LATIN)
    alike = [c for c in foreign if c.translate(_LOOK_ALIKES).isascii()]
    stem = composed and len(scripts) == len(runs) and runs[0][1].isascii()
    if len(scripts) > 1 and not stem and not all(map(_is_clear, foreign)):
        return (
            f"mixes {' and '.join(map(str, scripts))} letters: write it in one script"
        )
    if foreign and len(alike) == len(foreign):
        latin = word.translate(_LOOK_ALIKES)
        return f"looks like '{latin}', but holds {_shown(alike[0])}: write it in ASCII, or use another name"
    return ""


def _runs(word: str) -> list[str]:
    """The parts of a word that are of one script each, without its digits."""
    letters = (character for character in word if not character.isdigit())
    return ["".join(run) for _, run in groupby(letters, _script)]


def _is_clear(character: str) -> bool:
    """Whether a letter of another script is never taken for a Latin one or an operator."""
    if _script(character) == _EAST_ASIAN:
        return not character.translate(_LOOK_ALIKES).isascii()
    return character in _CLEAR_GREEK


def _script(text: str) -> str | None:
    """Script of a letter or mark, the first of a text; None where it is of none that names are written in."""
    character = text[0]
    name = unicodedata.name(character, "")
    script = _SCRIPTS.get(re.split("[ -]", name)[0])
    base = unicodedata.normalize("NFD", character)[0]
    match script:
        case "Latin":
            known = base.isascii() or base in _LATIN_WITHOUT_ASCII
        case "Greek":
            known = "Α" <= base <= "ω"
        case "Cyrillic":
            known = "Ѐ" <= base <= "ԯ"
        case _:
            known = not name.startswith("HANGUL") or name.startswith("HANGUL SYLLABLE")
    return script if known and unicodedata.category(character)[0] in "LM" else None


def _is_hidden(character: str) -> bool:
    """Whether it is a letter or mark that is not drawn."""
    return (
        re.search(
            "FILLER|VARIATION SELECTOR|INHERENT|GRAPHEME JOINER",
            unicodedata.name(character, ""),
        )
        is not None
    )


def _runs_leftwards(character: str) -> bool:
    return unicodedata.bidirectional(character) in (
        "R",
        "AL",
        "AN",
        "RLE",
        "LRE",
        "RLO",
        "LRO",
        "RLI",
        "LRI",
        "FSI",
    )


def _is_formula(name: str, symbols: Collection[str]) -> bool:
    """Whether it is a sum or difference, or a quotient, of parameters, symbols and numbers."""
    operands = [part for part in re.split(r"[-+/=\s]+", name) if part]
    if len(operands) < 2 or not re.search(r"[-+/=]", name):
        return False
    known = [part in symbols for part in operands]
    if re.search(r"\s[-+/=]\s", name) and any(known):
        return True
    numbers = [_NUMBER.fullmatch(part) is not None for part in operands]
    return all(a or b for a, b in zip(known, numbers, strict=True)) and (
        any(known) or "+" in name
    )


def _shown(character: str) -> str:
    """A character as people can tell it: ASCII itself, all others by number and name."""
    if character.isascii() and character.isprintable():
        return f"'{character}'"
    return (
        f"U+{ord(character):04X} ({unicodedata.name(character, 'a control character')})"
    )
