"""Formulas as papers print them, in the plain grammar of expressions, or refused where they can be read in two ways.

Papers write products with a blank or nothing: ``2 RL4 MZ4``, ``D3² (M3 + M4)``, ``2d3 MZ3``.  So two factors side by
side are a product, except where that is a guess:

- a number after a factor is an index (``XX 3``), a lost power (``D3 2``), or the number of an equation (``YY3 (2)``);
- a number in brackets before a factor, or one that ends in a point, may number the row: ``(2) XX2``, ``2. XX2``;
- what follows a quotient may belong to its divisor: ``1/2 RL4``.

In a text, rows are separated by the ends of lines, by commas and by semicolons, and may have a label: ``XX2R = XX2 −
YY2`` or ``3: XY2``.  A row goes on where a line ends in an operator or in an open bracket, and where the next one
begins with an operator.  A line that begins with a minus sign may also be an entry of a list, so it is refused.

A line is a remark if it holds no standard parameter, but two words or more that are no beginning of a known name, or
nothing but a heading's label.  Remarks are named in the result.  Everything else is a row, and is read or refused.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from keyword import iskeyword

from echelon.shared import shortened

FUNCTIONS = frozenset({"sin", "cos", "sqrt"})
_SIGNS = str.maketrans(
    {
        **dict.fromkeys("−–‐‑", "-"),
        **dict.fromkeys("·×⋅∙∗", "*"),
        **dict.fromkeys("⁄∕", "/"),
        **{"½": "(1/2)", "¼": "(1/4)", "¾": "(3/4)"},
    }
)
_SUBSCRIPTS = str.maketrans("₀₁₂₃₄₅₆₇₈₉", "0123456789")
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")
_SUPERSCRIPT = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
COMMENT = re.compile(r"\s*(#|%|//).*$")
_SEPARATOR = re.compile(r"\s*[,;]\s*")
_GOES_ON = re.compile(r"[-+*/^(=]$")
_CONTINUES = re.compile(r"[+*/)]")


def plain_signs(text: str) -> str:
    """A formula with the signs of formatted output (−, ·, ², ₃, √2, ^) in plain characters."""
    text = text.translate(_SIGNS).translate(_SUBSCRIPTS)
    # a blank ends the power, so that it cannot go on in a digit
    text = _SUPERSCRIPT.sub(lambda f: f"**{f[0].translate(_SUPERSCRIPTS)} ", text)
    text = re.sub(r"√(\d)", r"sqrt(\1)", text).replace("^", "**")
    return re.sub(r"\b(sin|cos)\*\*(\d+) ?\(([^()]*)\)", r"\1(\3)**\2", text)


@dataclass(frozen=True)
class Token:
    """A piece of a formula."""

    kind: str  # ``number``, ``name``, ``operator``, ``blank`` or ``other``
    text: str

    @property
    def ends_factor(self) -> bool:
        """Whether it may be the end of a factor."""
        return self.kind in ("number", "name") or self.text == ")"

    @property
    def begins_factor(self) -> bool:
        """Whether it may be the beginning of a factor."""
        return self.kind in ("number", "name") or self.text == "("


@dataclass(frozen=True)
class Notation:
    """The names that formulas may hold."""

    parameters: Collection[str]
    symbols: Collection[str]

    def names_in(self, text: str) -> list[str]:
        """Names that occur in a formula, in order, by what they stand for."""
        return [
            self.meant(token.text)
            for token in self.tokens(text)
            if token.kind == "name" and token.text not in (*FUNCTIONS, "pi")
        ]

    def meant(self, name: str) -> str:
        """The known name that a printed one stands for: indices may hang on an underscore, as in ``D_3`` for ``D3``."""
        if name in self.parameters or name in self.symbols:
            return name
        found = self._without_underscores.get(_joined(name), ())
        return found[0] if len(found) == 1 else name

    def tokens(self, text: str) -> Iterator[Token]:
        """The pieces of a formula."""
        for found in self._pattern.finditer(plain_signs(text)):
            yield Token(str(found.lastgroup), found[0])

    def plain(self, text: str) -> tuple[str, dict[str, str]]:
        """A formula with all its products written, and for every word that was replaced the original.

        Raises
        ------
        ValueError
            If it can be read in two ways, or holds a character that no formula has; says what to write.
        """
        tokens = list(self.tokens(text))
        self._check(tokens, text)
        stands_for: dict[str, str] = {}
        pieces: list[str] = []
        last = Token("other", "")
        for token in tokens:
            if token.begins_factor and last.ends_factor and last.text not in FUNCTIONS:
                pieces.append("*")
            pieces.append(self._identifier(token, stands_for))
            if token.kind != "blank":
                last = token
        return "".join(pieces).strip(), stands_for

    def is_remark(self, line: str) -> bool:
        """Whether a line is prose, or a heading, and no row."""
        if any(name in self.parameters for name in self.names_in(line)):
            return False
        label, separator, formula = _labelled(line)
        if separator == ":" and not formula:
            return bool(re.search(r"[^\W\d_]", label))
        if not re.search(r"\w", line):
            return True
        words = re.findall(r"(?<!\w)[^\W\d_]{2,}(?!\w)", formula)
        prose = [word for word in words if word not in self._beginnings]
        return len([word for word in prose if word not in FUNCTIONS]) >= 2

    # -- parts ---------------------------------------------------------------------------------------------------------

    @cached_property
    def _odd(self) -> list[str]:
        """Names that are no identifiers, such as those of the body ``panda-link1``."""
        odd = (name for name in self.parameters if not name.isidentifier())
        return sorted(odd, key=len, reverse=True)

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        odd = "|".join(map(re.escape, self._odd))
        names = rf"(?<!\w)(?:{odd})(?!\w)|[^\W\d]\w*" if odd else r"[^\W\d]\w*"
        return re.compile(
            r"(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
            rf"|(?P<name>{names})|(?P<operator>\*\*|[-+*/()])|(?P<blank>\s+)|(?P<other>.)"
        )

    @cached_property
    def _without_underscores(self) -> dict[str, list[str]]:
        """Known names by their spelling without underscores before digits."""
        found: dict[str, list[str]] = {}
        for name in {*self.parameters, *self.symbols}:
            found.setdefault(_joined(name), []).append(name)
        return found

    @cached_property
    def _beginnings(self) -> frozenset[str]:
        """All that known names begin with."""
        names = (*self.parameters, *self.symbols)
        return frozenset(n[:k] for n in names for k in range(1, len(n) + 1))

    def _identifier(self, token: Token, stands_for: dict[str, str]) -> str:
        name = self.meant(token.text) if token.kind == "name" else token.text
        if token.kind != "name" or name.isidentifier():
            return name
        placeholder = f"word_{len(stands_for)}_"
        stands_for[placeholder] = name
        return placeholder

    def _check(self, tokens: list[Token], text: str) -> None:
        """Refuse what can be read in two ways."""
        for token in tokens:
            if token.kind == "other" or iskeyword(token.text):
                raise ValueError(
                    f"'{token.text}' is not allowed in an expression: '{shortened(text)}'"
                )
            self._check_name(token)
        solid = [token for token in tokens if token.kind != "blank"]
        for k, (left, right) in enumerate(pairwise(solid)):
            if left.text in FUNCTIONS and right.text != "(":
                raise ValueError(
                    f"'{left.text} {right.text}': write {left.text}({right.text})"
                )
            if left.ends_factor and right.begins_factor and left.text not in FUNCTIONS:
                _check_product(solid, k)

    def _check_name(self, token: Token) -> None:
        """Refuse names that are also a formula of other names, and numbers that are also a product."""
        known = {*self.parameters, *self.symbols} if token.kind == "number" else ()
        exponent = re.search(r"[eE]\d*", token.text)
        if token.kind == "number" and exponent and exponent[0] in known:
            raise ValueError(
                f"'{token.text}' is a number, but {exponent[0]} is a symbol: "
                f"write {token.text[: exponent.start()]}*{exponent[0]}, or the number without a power of ten"
            )
        if token.kind != "name" or token.text.isidentifier():
            return
        parts = re.findall(r"\w+", token.text)
        if all(p in self.parameters or p in self.symbols for p in parts):
            raise ValueError(
                f"'{token.text}' is the name of a parameter and a formula of {', '.join(parts)}: name the body by its "
                "number"
            )


def _joined(name: str) -> str:
    return re.sub(r"_(?=\d)", "", name)


def _check_product(tokens: list[Token], k: int) -> None:
    """Refuse two factors side by side, from the k-th token on, where that is no sure product."""
    left, right = tokens[k], tokens[k + 1]
    before, after = _number_in_brackets(tokens, k), _number_in_brackets(tokens, k + 1)
    shown = f"'{before or left.text} {after or right.text}'"
    if right.kind == "number" or after:
        raise ValueError(
            f"{shown} can be an index, a power, a product or a number of an equation: write XX3, XX^3 or 3*XX, or "
            "remove the number"
        )
    if before or (left.kind == "number" and left.text.endswith(".")):
        number = (before or left.text).strip("().")
        raise ValueError(
            f"{shown} can be a number of a row or a product: write {number}: or {number}*"
        )
    if _is_divided(tokens, k):
        raise ValueError(
            f"what follows '/' before {shown} can belong to the divisor or not: write brackets, as in (1/2)*RL4"
        )


def _number_in_brackets(tokens: list[Token], k: int) -> str:
    """The number in brackets that ends or begins at a bracket, or nothing."""
    three = (
        tokens[max(k - 2, 0) : k + 1] if tokens[k].text == ")" else tokens[k : k + 3]
    )
    texts = [token.text for token in three]
    found = len(three) == 3 and three[1].kind == "number"
    called = tokens[k].text == ")" and k > 2 and tokens[k - 3].text in FUNCTIONS
    return "".join(texts) if found and texts[::2] == ["(", ")"] and not called else ""


def _is_divided(tokens: list[Token], k: int) -> bool:
    """Whether the last operator before the end of a factor, in its term, divides."""
    depth = 0
    for token in reversed(tokens[: k + 1]):
        depth += (token.text == ")") - (token.text == "(")
        if depth < 0:
            return False
        if depth == 0 and token.text in ("/", "*", "+", "-"):
            return token.text == "/"
    return False


# -- lines -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Line:
    """A line of a text without its comment, or several that are one row."""

    text: str
    where: str  # ``line 3``, ``lines 3 to 4``


def lines_of(text: str) -> list[Line]:
    """The lines of a text that are not blank, joined where a row goes on."""
    found: list[Line] = []
    first, filled = (
        0,
        False,
    )  # number of the last line's beginning; whether the line before holds something
    for number, raw in enumerate(text.splitlines(), 1):
        content = COMMENT.sub("", raw).strip().rstrip(";,.").rstrip()
        if not content:
            filled = filled and bool(
                raw.strip()
            )  # comments stand between lines of one text
            continue
        joined = filled and (_is_open(found[-1].text) or _continues(content))
        if joined:
            last = found.pop()
            where = f"lines {first} to {number}"
            found.append(Line(f"{last.text} {content}", where))
        else:
            first = number
            found.append(Line(content, f"line {number}"))
        filled = True
    return found


def _is_open(text: str) -> bool:
    plain = plain_signs(text)
    return bool(_GOES_ON.search(plain)) or plain.count("(") > plain.count(")")


def _continues(text: str) -> bool:
    return bool(_CONTINUES.match(plain_signs(text)))


def parts_of_line(line: Line) -> list[tuple[str | None, str]]:
    """Labels and formulas of the rows in a line.

    Raises
    ------
    ValueError
        If it can be read in two ways, or a label has no formula; says what to write.
    """
    if re.search(r"\d,\d", line.text):
        raise ValueError(
            f"'{shortened(line.text)}' has a comma between digits: write 0.45 for a number, or a blank behind the comma"
        )
    if plain_signs(line.text).startswith("-"):
        raise ValueError(
            f"'{shortened(line.text)}' begins with '-': put it behind the line before if it goes on from there, in "
            "brackets if it is a row with this sign, or remove the sign if it marks an entry of a list"
        )
    found: list[tuple[str | None, str]] = []
    for part in _SEPARATOR.split(line.text):
        label, separator, formula = _labelled(part)
        if not formula or re.search("[=:]", formula):
            raise ValueError(f"'{shortened(part)}' is no row: write NAME = EXPRESSION")
        found.append((label if separator else None, formula))
    return found


def _labelled(text: str) -> tuple[str, str, str]:
    """Label, ``=`` or ``:``, and formula; the first two are empty where there is no label."""
    found = re.match(r"([^=:]*[^=:\s])\s*([=:])\s*(.*)$", text)
    return (found[1], found[2], found[3]) if found else ("", "", text)


def numbering_problem(formulas: Iterable[str]) -> list[str]:
    """Why rows that begin with 1, 2, 3 … cannot be read, which may number them or be factors; else nothing."""
    begins = [re.match(r"(\d+)\s+\D", formula) for formula in formulas]
    numbers = [int(found[1]) if found else None for found in begins]
    if len(numbers) >= 3 and numbers == list(range(1, len(numbers) + 1)):
        return [
            "the rows begin with 1, 2, 3 …, which reads as factors: write '1:' if they number the rows"
        ]
    return []
