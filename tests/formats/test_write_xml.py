"""Edited texts of XML documents against edited trees."""

from __future__ import annotations

from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st

from echelon.formats.writers.xml_editor import XmlEditor, quoted

NAMES = st.sampled_from(["a", "b", "c"])
VALUES = st.text(st.sampled_from("<>&'\"= /\n\té𝕏-!1"), max_size=6)
BETWEEN = st.sampled_from(
    ["", " ", "\n\t", "<!-- <a b='1'> -->", "<![CDATA[<a/>]]>", "<?p <a?>", "text"]
)


@st.composite
def documents(draw: st.DrawFn, depth: int = 2) -> str:
    tag, attributes = draw(NAMES), draw(st.dictionaries(NAMES, VALUES, max_size=3))
    start = f"<{tag}" + "".join(
        f"\n {name} = {quoted(value)}" for name, value in attributes.items()
    )
    if not depth or draw(st.booleans()):
        return start + draw(st.sampled_from(["/>", " />", f"></{tag}>"]))
    children = draw(st.lists(st.tuples(BETWEEN, documents(depth - 1)), max_size=3))
    return f"{start}>{''.join(before + child for before, child in children)}{draw(BETWEEN)}</{tag} >"


@given(documents(), st.data())
def test_edited_documents_parse_as_if_their_elements_had_been_edited(
    text: str, data: st.DataObject
) -> None:
    editor, expected = XmlEditor(text, "a.xml"), ElementTree.fromstring(text)
    assert editor.result() == text
    elements = list(zip(editor.root.iter(), expected.iter(), strict=True))
    for found, element in elements:
        values = data.draw(st.dictionaries(NAMES, VALUES, max_size=2))
        editor.set_attributes(found, values)
        element.attrib.update(values)
    found = ElementTree.fromstring(editor.result())
    assert [(e.tag, e.attrib, e.text, e.tail) for e in found.iter()] == [
        (e.tag, e.attrib, e.text, e.tail) for e in expected.iter()
    ]


@given(documents(), st.data())
def test_elements_are_inserted_removed_and_replaced(
    text: str, data: st.DataObject
) -> None:
    editor, expected = XmlEditor(text, "a.xml"), ElementTree.fromstring(text)
    number = data.draw(st.integers(0, len(list(expected.iter())) - 1))
    change = (
        data.draw(st.sampled_from(["insert", "remove", "replace"]))
        if number
        else "insert"
    )
    place, element = list(editor.root.iter())[number], list(expected.iter())[number]
    if change == "insert":
        editor.insert_first(place, ["<new/>"])
        element.insert(0, ElementTree.Element("new"))
    elif change == "replace":
        editor.replace(place, "<new/>")
        element.tag = "new"
        element.attrib.clear()
        for child in list(element):
            element.remove(child)
    else:
        editor.remove(place)
        (parent,) = (e for e in expected.iter() if element in list(e))
        parent.remove(element)
    found = ElementTree.fromstring(editor.result())
    assert [(e.tag, e.attrib) for e in found.iter()] == [
        (e.tag, e.attrib) for e in expected.iter()
    ]
