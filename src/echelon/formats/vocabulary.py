"""Whatever a robot file says is read, refused, or named with the result.

The reader of an XML format states a vocabulary: for each element, the names that it reads, those that say nothing about
how a robot moves, and those that are listed as not read.  Any other name is refused where it could change the dynamics,
as in a link or a joint, and listed elsewhere.  What a user wants to be ignored is taken out of the document before
anything reads it.

Names are those of elements, such as ``mimic``, or of attributes, such as ``@xyz``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from enum import Enum
from pathlib import PurePath
from typing import Any

from echelon.shared import InputError, nearest

_OF_XML = (
    "xmlns",
    "xmlns:",
    "xml:",
    "xsi:",
)  # how attributes begin that are about the document itself


class Otherwise(Enum):
    """Fate of a name that an element's vocabulary does not have."""

    REFUSED = "refused"
    LISTED = "listed"
    QUIET = "quiet"


@dataclass(frozen=True)
class Element:
    """The names that may stand in an element; several in one text, separated by spaces."""

    inside: Mapping[str, Element] = field(
        default_factory=dict
    )  # elements whose content counts
    attributes: str = ""  # attributes that are read, without @
    harmless: str = ""  # names that say nothing about motions
    listed: str = ""  # names that are listed as not read
    single: str = (
        ""  # elements of which a reader takes the first only; others are listed
    )
    otherwise: Otherwise = Otherwise.REFUSED
    # what to write instead of a name that is refused, by name; of all others under the empty one
    advice: Mapping[str, str] = field(default_factory=dict)

    def fate(self, name: str) -> Otherwise | None:
        """Fate of a name; None if it is read."""
        if name in self.inside or name.removeprefix("@") in self.attributes.split():
            return None
        if name in self.harmless.split():
            return Otherwise.QUIET
        return Otherwise.LISTED if name in self.listed.split() else self.otherwise

    @property
    def read(self) -> list[str]:
        """The names that are read."""
        return [*self.inside, *(f"@{name}" for name in self.attributes.split())]


def unread(root: Any, known: Element, source: str) -> tuple[str, ...]:
    """A note on what a document says beyond the vocabulary of its root; none where that is all.

    Raises
    ------
    InputError
        For a name that could change how the robot moves; says what to write instead.
    """
    account = _Account(source)
    account.visit(root, known, _place(root, ""))
    found = [
        name if count == 1 else f"{name} ({count} times)"
        for name, count in account.found.items()
    ]
    return (f"not read: {', '.join(found)}",) if found else ()


class _Account:
    """The names that were found and are not read, in the order of the document."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.found: Counter[str] = Counter()

    def visit(self, element: Any, known: Element, where: str) -> None:
        """Go through an element and all elements that count in it."""
        for name, value in element.items():
            if value.strip() and not name.startswith(
                _OF_XML
            ):  # an empty one says nothing
                self._meet(f"@{name}", element, known, where)
        for tag, count in Counter(child.tag for child in element).items():
            if count > 1 and tag in known.single.split():
                self.found[f"{element.tag}/{tag} after the first"] += count - 1
        for child in element:
            if child.tag in known.inside:
                self.visit(child, known.inside[child.tag], _place(child, where))
            else:
                self._meet(child.tag, element, known, where)

    def _meet(self, name: str, element: Any, known: Element, where: str) -> None:
        fate = known.fate(name)
        if fate is Otherwise.LISTED:
            self.found[
                f"{element.tag}{name}"
                if name.startswith("@")
                else f"{element.tag}/{name}"
            ] += 1
        elif fate is Otherwise.REFUSED:
            shown = (
                f"the attribute '{name[1:]}'" if name.startswith("@") else f"<{name}>"
            )
            said = known.advice.get(name, known.advice.get("", "")).format(
                file=PurePath(self.source).name
            )
            problem = (
                f"{shown} is not read, and may change how the robot moves{nearest(name, known.read)}{said}; "
                f"if it does not matter: --ignore {name}, or in Python ignore=['{name}']"
            )
            raise InputError(problem, source=self.source, element=where)


def _place(element: Any, within: str) -> str:
    """An element in words, by its name or else by what it stands in."""
    name = element.get("name")
    own = f"{element.tag} '{name}'" if name else element.tag
    return f"{within} {own}" if within and not name else own


# -- names to ignore ---------------------------------------------------------------------------------------------------


def without(root: Any, ignored: Collection[str], source: str) -> Any:
    """A copy of a document without the elements and attributes that a user wants to be ignored.

    A name is that of an element (``loop``), of an attribute (``@quat``), or of either within an element
    (``gazebo/joint``, ``origin@quat``).

    Raises
    ------
    InputError
        If the document does not have one of the names.
    """
    root = deepcopy(root)
    left = set(ignored)
    for element in list(root.iter()):
        for attribute in list(element.keys()):
            if named := {f"@{attribute}", f"{element.tag}@{attribute}"} & set(ignored):
                del element.attrib[attribute]
                left -= named
        for child in list(element):
            if named := {child.tag, f"{element.tag}/{child.tag}"} & set(ignored):
                element.remove(child)
                left -= named
    if left:
        name = min(left)
        known = dict.fromkeys(_names_of(root))
        raise InputError(
            f"it has no '{name}' that could be ignored{nearest(name, known)}",
            source=source,
        )
    return root


def _names_of(root: Any) -> Iterator[str]:
    for element in root.iter():
        yield element.tag
        yield from (f"@{attribute}" for attribute in element.keys())  # noqa: SIM118  # an element, no mapping
