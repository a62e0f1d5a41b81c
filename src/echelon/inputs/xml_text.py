"""XML of untrusted files: entities and external references are refused before anything else looks at the text."""

from __future__ import annotations

from typing import Any

from echelon.errors import InputError
from echelon.inputs.content import DOCUMENT, XML_DEPTH, XML_NODES


def parse_xml(text: str | bytes, source: str) -> Any:
    """Root element of an XML document, with entities and external references refused."""
    from xml.etree.ElementTree import ParseError

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    _check_size(text, source)
    try:
        root = fromstring(text, forbid_dtd=True)
    except ParseError as error:
        raise InputError(f"not well-formed XML: {error}", source=source) from None
    except DefusedXmlException:
        raise InputError("document type declarations and entities are not accepted", source=source) from None
    except (ValueError, LookupError) as error:
        raise InputError(f"cannot be decoded: {error}", source=source) from None
    level, depth = [root], 0
    while level:
        depth += 1
        XML_DEPTH.check(depth, source)
        level = [child for element in level for child in element]
    return root


def _check_size(text: str | bytes, source: str) -> None:
    """Each element and each attribute has one of these characters, in every encoding."""
    DOCUMENT.check(len(text), source)
    found = text.count("<") + text.count("=") if isinstance(text, str) else text.count(b"<") + text.count(b"=")
    XML_NODES.check(found, source)
