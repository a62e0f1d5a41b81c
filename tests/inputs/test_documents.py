"""Limits of documents: the largest that is accepted, and one more."""

from __future__ import annotations

import pytest

from echelon.shared.errors import InputError
from echelon.shared.inputs import DEPTH, Limit, parse_json, parse_xml, parse_yaml


def test_a_limit_is_the_largest_number() -> None:
    limit = Limit(5, "columns")
    limit.check(5)
    with pytest.raises(InputError, match="has more than 5 columns"):
        limit.check(6)


@pytest.mark.parametrize("parse", [parse_json, parse_yaml])
def test_nesting(parse) -> None:
    parse("[" * DEPTH.most + "]" * DEPTH.most, "file")
    with pytest.raises(InputError, match=f"more than {DEPTH.most} levels"):
        parse("[" * (DEPTH.most + 1) + "]" * (DEPTH.most + 1), "file")


@pytest.mark.parametrize(
    ("parse", "text"), [(parse_json, '{"a": 1, "a": 2}'), (parse_yaml, "a: 1\na: 2")]
)
def test_a_key_occurs_once(parse, text: str) -> None:
    with pytest.raises(InputError, match="the key 'a' occurs twice"):
        parse(text, "file")


def test_document_types_are_refused_even_without_entities() -> None:
    with pytest.raises(InputError, match="document type declarations"):
        parse_xml("<!DOCTYPE robot><robot/>", "file")


def test_xml_is_read_as_other_readers_do() -> None:
    text = "<r><!-- a -- b ---><b drake:k='1'><drake:c/></b><![CDATA[<!-- -- -->]]></r>"
    for content in (
        text,
        text.encode(),
        f"<?xml version='1.0' encoding='latin-1'?>{text}",
    ):
        root = parse_xml(content, "r.urdf")
        assert [(element.tag, dict(element.attrib)) for element in root.iter()] == [
            ("r", {}),
            ("b", {"drake:k": "1"}),
            ("drake:c", {}),
        ]
        assert root[0].tail == "<!-- -- -->"


@pytest.mark.parametrize(
    "text",
    ["<r><!-- a -- <b/></r>", "<r>&lt;<b></r>", "<r/>more", "", "<r>&entity;</r>"],
)
def test_xml_that_is_not_well_formed_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"r.urdf: not well-formed XML: .*line 1"):
        parse_xml(text, "r.urdf")
