"""Changes to the text of an XML document that leave all else as it is, to the byte.

Parsing and printing a document would lose comments, quotes and line breaks.  So the parser only decides what the
elements are; their places come from a scan of the text, whose start tags are in the order of the parsed elements.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

from echelon.shared import InputError, parse_xml

_TAG = re.compile(
    r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<(?P<end>/?)(?P<name>[^\s/>!?]+)(?:[^>\"']|\"[^\"]*\"|'[^']*')*>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"([^\s=<>\"'/]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_DECLARATION = re.compile(
    r"^\ufeff?<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z][A-Za-z0-9._-]*)[\"']"
)
_UNIT = "  "


@dataclass(frozen=True)
class _Span:
    """Places of an element: its start tag, the end of that, its end tag, and the end of that."""

    start: int
    content: int
    close: int
    end: int

    @property
    def is_empty(self) -> bool:
        """Whether it is one tag, ``<a/>``."""
        return self.content == self.end


class XmlEditor:
    """Gathers changes to a document and makes them at once."""

    def __init__(self, text: str, source: str) -> None:
        self.text = text
        self.root: Any = parse_xml(text, source)
        self._newline = "\r\n" if "\r\n" in text else "\n"
        self._spans = _spans(text, self.root)
        self._edits: list[tuple[int, int, str]] = []

    def inside(self, element: Any) -> str:
        """The text between an element's tags."""
        span = self._spans[element]
        return "" if span.is_empty else self.text[span.content : span.close]

    def replace(self, element: Any, text: str) -> None:
        """Put other text in the place of an element."""
        span = self._spans[element]
        self._edits.append((span.start, span.end, text))

    def remove(self, element: Any) -> None:
        """Take an element out, with its line if it had that to itself."""
        span = self._spans[element]
        line = self._line_start(span.start)
        rest = re.compile(r"[ \t]*\r?\n").match(self.text, span.end)
        if rest and not self.text[line : span.start].strip():
            self._edits.append((line, rest.end(), ""))
        else:
            self._edits.append((span.start, span.end, ""))

    def set_attributes(
        self, element: Any, values: Mapping[str, str], instead: Collection[str] = ()
    ) -> None:
        """Set attributes of an element instead of some; the others, and how the tag is written, stay."""
        if not values:
            return
        span = self._spans[element]
        tag, missing = self.text[span.start : span.content], dict(values)
        pieces, at = [], 0
        for match in _ATTRIBUTE.finditer(tag):
            if match[1] in instead:
                pieces.append(tag[at : match.start()].rstrip())
                at = match.end()
            if match[1] in missing:
                pieces += [tag[at : match.start(2)], quoted(missing.pop(match[1]))]
                at = match.end(2)
        rest = tag[at:]
        end = re.search(r"\s*/?>$", rest)
        assert end is not None, "a tag ends in >"
        added = "".join(f" {name}={quoted(value)}" for name, value in missing.items())
        self._edits.append(
            (
                span.start,
                span.content,
                "".join([*pieces, rest[: end.start()], added, rest[end.start() :]]),
            )
        )

    def drop_attributes(self, element: Any, names: Collection[str]) -> None:
        """Take attributes out of an element, with the space before them."""
        span = self._spans[element]
        for match in _ATTRIBUTE.finditer(self.text, span.start, span.content):
            if match[1] in names:
                gap = len(self.text[span.start : match.start()]) - len(
                    self.text[span.start : match.start()].rstrip()
                )
                self._edits.append((match.start() - gap, match.end(), ""))

    def insert_first(self, element: Any, lines: Sequence[str]) -> None:
        """Put lines before everything else in an element."""
        span = self._spans[element]
        before = self.text[self._line_start(span.start) : span.start]
        outer = "" if before.strip() else before
        first = (
            None
            if span.is_empty
            else re.compile(r"\s*\n([ \t]*)<(?!/)").match(self.text, span.content)
        )
        inner = self._newline + (first[1] if first else outer + _UNIT)
        block = "".join(inner + line for line in lines)
        if not span.is_empty:
            has_lines = self.text.find("\n", span.content, span.close) >= 0
            self._edits.append(
                (
                    span.content,
                    span.content,
                    block if has_lines else block + self._newline + outer,
                )
            )
            return
        tag = self.text[span.start : span.end].removesuffix("/>").rstrip()
        name = re.match(r"<([^\s/>]+)", tag)
        assert name is not None, "a tag has a name"
        self._edits.append(
            (span.start, span.end, f"{tag}>{block}{self._newline}{outer}</{name[1]}>")
        )

    def result(self) -> str:
        """The text with all changes."""
        pieces, at = [], 0
        for start, end, text in sorted(self._edits, key=lambda edit: edit[:2]):
            pieces += [self.text[at:start], text]
            at = end
        return "".join([*pieces, self.text[at:]])

    def _line_start(self, place: int) -> int:
        return self.text.rfind("\n", 0, place) + 1


def decoded(data: bytes, source: str) -> str:
    """The text of a document, whose declaration says UTF-8 afterwards; line breaks stay as they are."""
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    declared = _DECLARATION.match(data[:200].decode("latin-1").removeprefix("ï»¿"))
    name = "utf-16" if wide else declared[1] if declared else "utf-8"
    try:
        text = data.decode(name)
    except (UnicodeDecodeError, LookupError) as error:
        raise InputError(f"cannot be decoded: {error}", source=source) from None
    stated = _DECLARATION.match(text)
    if stated is None or stated[1].lower() in ("utf-8", "utf8"):
        return text
    return f"{text[: stated.start(1)]}UTF-8{text[stated.end(1) :]}"


def quoted(value: str) -> str:
    """An attribute's value in quotes, escaped."""
    if any(not _is_allowed(character) for character in value):
        raise InputError(
            f"XML cannot have the name {value!r}: it has control characters"
        )
    return f'"{escape(value, {chr(34): "&quot;", chr(10): "&#10;", chr(13): "&#13;", chr(9): "&#9;"})}"'


def comment(lines: Sequence[str]) -> list[str]:
    """Lines of a comment; two hyphens, which end one, are parted, and control characters replaced."""

    def safe(line: str) -> str:
        printable = "".join(
            c if c.isprintable() and _is_allowed(c) else " " for c in line
        )
        return re.sub("-(?=-)", "- ", printable)

    return ["<!--", *(f"{_UNIT}{safe(line)}" for line in lines), "-->"]


def _is_allowed(character: str) -> bool:
    code = ord(character)
    return character in "\t\n\r" or (
        code >= 0x20 and not 0xD800 <= code <= 0xDFFF and code not in (0xFFFE, 0xFFFF)
    )


def _spans(text: str, root: Any) -> dict[Any, _Span]:
    elements: Iterator[Any] = root.iter()
    spans: dict[Any, _Span] = {}
    open_tags: list[tuple[Any, int, int]] = []
    for tag in _TAG.finditer(text):
        if tag["name"] is None:
            continue
        if tag["end"]:
            element, start, content = open_tags.pop()
            spans[element] = _Span(start, content, tag.start(), tag.end())
        elif tag[0].endswith("/>"):
            spans[next(elements)] = _Span(tag.start(), tag.end(), tag.end(), tag.end())
        else:
            open_tags.append((next(elements), tag.start(), tag.end()))
    return spans
