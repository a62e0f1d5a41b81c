"""Changes that make a file nearly right: of bytes, of text, and of the data that a document holds."""

from __future__ import annotations

import copy
import re
import struct
from collections.abc import Callable, Iterator
from random import Random
from typing import Any
from xml.etree import ElementTree

NUMBERS = (
    *(
        "0",
        "-0.0",
        "-1",
        "1",
        "0.5",
        "1e308",
        "-1e308",
        "1e-320",
        "1e400",
        "1e-400",
        "nan",
        ".nan",
        "inf",
        "-.inf",
    ),
    *(
        "9" * 30,
        "1" + "0" * 400,
        "1" * 5000,
        "2147483648",
        "18446744073709551616",
        "1_000",
        "0x10",
        "١",
        "²",
        "1,5",
    ),
)
TEXTS = (
    *(
        "",
        " ",
        "~",
        "null",
        "true",
        "*",
        "&a",
        "*a",
        "<<",
        "!!python/none x",
        "a" * 5000,
        "\x1b[31m",
        "ё",
        "q1\nq2",
    ),
    *(
        "../../etc/passwd",
        "/dev/null",
        "1/0",
        "sqrt(-1)",
        "pi/0",
        "x**9**9",
        "9**9**9",
        "(" * 300 + ")" * 300,
    ),
    *(
        "1 + 2·MX2",
        "l1·M2",
        "М2",
        "Μ2",
        "lеft",
        "arm\u200b",
        "\u202earm",
        "e\u0301",
        "ｌ１",
        "左臂",
        "θ1",
        "j2-left",
        "ذراع",
    ),
    *(
        "0.3 # $\\input{x}",
        "__import__('os')",
        "atan2(0, 0)",
        "1e999*l1",
        "l1",
        "j1",
        "all",
        "world",
        "-",
        "1 2 3",
    ),
)
_WHOLE = (
    0,
    1,
    -1,
    2,
    127,
    255,
    65535,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63 - 1,
    10**9,
    10**30,
)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_WORD = re.compile(r"[A-Za-z_][\w.]*")


def plain_value(rng: Random) -> Any:
    """Something that a document can hold and that is rarely right."""
    kind = rng.randrange(6)
    if kind == 0:
        return rng.choice(_WHOLE)
    if kind == 1:
        return rng.choice(
            (0.0, -1.5, 1e308, 1e-308, 5e-324, float("inf"), float("nan"))
        )
    if kind == 2:
        return rng.choice((None, True, False, [], {}, [[]], {"": ""}, [None]))
    if kind == 3:
        deep: Any = 1
        for _ in range(rng.choice((5, 63, 70, 300))):
            deep = [deep] if rng.random() < 0.5 else {"a": deep}
        return deep
    if kind == 4:
        return [rng.choice(_WHOLE)] * rng.choice((1, 2, 3, 10, 3000))
    return rng.choice(NUMBERS + TEXTS)


def changed_data(data: Any, rng: Random) -> Any:
    """A document with one to three elements changed."""
    data = copy.deepcopy(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = list(_places(data))
        if places:
            _change(*rng.choice(places), places, rng)
    return data


def _places(data: Any) -> Iterator[tuple[Any, Any]]:
    """All elements: what holds them, and their key or index."""
    pending = [data]
    while pending:
        holder = pending.pop()
        keys = (
            list(holder)
            if isinstance(holder, dict)
            else range(len(holder))
            if isinstance(holder, list)
            else ()
        )
        for key in keys:
            yield holder, key
            pending.append(holder[key])


def _change(holder: Any, key: Any, places: list[tuple[Any, Any]], rng: Random) -> None:
    value, action = holder[key], rng.randrange(8)
    if action == 0:
        del holder[key]
    elif action == 1 and isinstance(holder, list):
        holder[key:key] = [copy.deepcopy(value)] * rng.choice((1, 2, 50))
    elif action == 2 and isinstance(holder, dict):
        holder[rng.choice((*TEXTS, str(key) + "x"))] = holder.pop(key)
    elif action == 3:
        other, place = rng.choice(places)
        # not into itself
        found = copy.deepcopy(
            other[place]
            if isinstance(other, list | dict) and _has(other, place)
            else None
        )
        holder[key] = found
    elif action == 4:
        holder[key] = rng.choice(([value], {"a": value}, str(value)))
    elif action == 5 and isinstance(value, int | float) and not isinstance(value, bool):
        holder[key] = rng.choice(
            (
                -value,
                value * 1e300,
                value * 1e-300,
                value + 1,
                int(value) if value == value and abs(value) < 1e300 else 0,
            )
        )
    elif action == 6 and isinstance(value, str):
        holder[key] = changed_text(value, rng)
    else:
        holder[key] = plain_value(rng)


def _has(holder: Any, key: Any) -> bool:
    return key in holder if isinstance(holder, dict) else key < len(holder)


def changed_text(text: str, rng: Random) -> str:
    """A text with one to three changes."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        text = rng.choice(_TEXT_CHANGES)(text, rng)
    return text


def _token(
    pattern: re.Pattern[str], values: tuple[str, ...]
) -> Callable[[str, Random], str]:
    def change(text: str, rng: Random) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        match = rng.choice(found)
        return (
            text[: match.start()]
            + rng.choice((*values, rng.choice(found)[0]))
            + text[match.end() :]
        )

    return change


def _lines(text: str, rng: Random) -> str:
    """A line lost, doubled, moved, or many times over."""
    lines = text.splitlines(keepends=True) or [""]
    k, other, action = (
        rng.randrange(len(lines)),
        rng.randrange(len(lines)),
        rng.randrange(5),
    )
    if action == 0:
        del lines[k]
    elif action == 1:
        lines[k:k] = [lines[k]] * rng.choice((1, 300))
    elif action == 2:
        lines[k], lines[other] = lines[other], lines[k]
    elif action == 3:
        lines[k] = " " * rng.randrange(5) + lines[k].lstrip()
    else:
        lines = lines[:k]
    return "".join(lines)


def _characters(text: str, rng: Random) -> str:
    k = rng.randrange(len(text) + 1)
    inserted = rng.choice(
        (
            "",
            "[",
            "]",
            "{",
            "}",
            ":",
            ",",
            "-",
            "'",
            '"',
            "#",
            "\n",
            "\t",
            "<",
            ">",
            "&",
            "*",
            "é",
            "\0",
            *TEXTS,
        )
    )
    return text[:k] + inserted + text[k + rng.choice((0, 1, 1, 8)) :]


_TEXT_CHANGES = (
    _token(_NUMBER, NUMBERS),
    _token(_NUMBER, NUMBERS),
    _token(_WORD, TEXTS),
    _lines,
    _characters,
)


def changed_bytes(content: bytes, rng: Random) -> bytes:
    """Bytes with one to four changes: flipped, lost, put in, doubled, and extreme integers."""
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        k, action = rng.randrange(len(found) + 1), rng.randrange(6)
        if action == 0 and k < len(found):
            found[k] ^= 1 << rng.randrange(8)
        elif action == 1:
            del found[k:]
        elif action == 2:
            found[k:k] = rng.randbytes(rng.choice((1, 4, 64)))
        elif action == 3:
            del found[k : k + rng.choice((1, 4, 64))]
        elif action == 4:
            found[k:k] = found[max(0, k - 64) : k]
        else:
            form = rng.choice(("<H", "<I", "<Q", ">I", ">Q"))
            size = struct.calcsize(form)
            found[k : k + size] = struct.pack(
                form, rng.choice(_WHOLE) % (1 << 8 * size)
            )
    return bytes(found)


def changed_xml(text: str, rng: Random) -> str:
    """An XML document with elements and attributes changed."""
    root = ElementTree.fromstring(text)
    for _ in range(rng.choice((1, 1, 2, 3))):
        elements = list(root.iter())
        element, other, action = (
            rng.choice(elements),
            rng.choice(elements),
            rng.randrange(6),
        )
        names = list(element.keys())
        if action <= 2 and names:
            name = rng.choice(names)
            value = element.get(name, "")
            element.set(
                name,
                rng.choice(
                    (
                        rng.choice(NUMBERS),
                        rng.choice(TEXTS),
                        *[changed_text(value, rng)] * 4,
                    )
                ),
            )
        elif action == 3 and names:
            del element.attrib[rng.choice(names)]
        elif action == 4:
            other.append(copy.deepcopy(element))
        elif len(element):
            element.remove(rng.choice(list(element)))
    return ElementTree.tostring(root, encoding="unicode")
