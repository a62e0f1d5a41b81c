"""XML of untrusted files: entities and external references are refused before anything else looks at the text."""

from __future__ import annotations

from typing import Any

from echelon.errors import InputError


def parse_xml(text: str | bytes, source: str) -> Any:
    """Root element of an XML document, with entities and external references refused.

    Raises
    ------
    InputError
        If the document is malformed or uses a forbidden feature.
    """
    from xml.etree.ElementTree import ParseError

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        return fromstring(text, forbid_dtd=True)
    except ParseError as error:
        raise InputError(f"not well-formed XML: {error}", source=source) from None
    except DefusedXmlException:
        raise InputError("document type declarations and entities are not accepted", source=source) from None
    except (ValueError, LookupError) as error:
        raise InputError(f"cannot be decoded: {error}", source=source) from None
