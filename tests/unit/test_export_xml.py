"""Changing XML where it stands: everything but what was asked for stays, byte by byte."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from ident.errors import ConfigurationError
from ident.exporting.xml_patch import NewElement, XmlPatch


def patched(text: str, change) -> str:  # type: ignore[no-untyped-def]
    patch = XmlPatch(text.encode(), "x")
    change(patch)
    return patch.result().decode()


def test_attributes_in_place() -> None:
    text = "<a>\n  <b  x = '1'\n   y=\"a &gt; b\" />\n</a>"
    assert patched(text, lambda p: p.set(p.root.find("b"), x="2")) == text.replace("'1'", '"2"')
    assert patched(text, lambda p: p.set(p.root.find("b"), z="<3>")) == '<a>\n  <b  x = \'1\'\n   y="a &gt; b" z="&lt;3&gt;"/>\n</a>'
    assert XmlPatch(text.encode(), "x").root.find("b").get("y") == "a > b"  # type: ignore[union-attr]
    # A name inside another's value is not the attribute.
    assert patched("<a t=' x=1' x='1'/>", lambda p: p.set(p.root, x="2")) == "<a t=' x=1' x=\"2\"/>"


def test_insertion_follows_the_indentation() -> None:
    new = NewElement("c", {"k": "v"}, [NewElement("d")])
    assert patched("<a>\n    <b/>\n</a>", lambda p: p.insert(p.root, new)) == '<a>\n    <c k="v">\n      <d/>\n    </c>\n    <b/>\n</a>'
    assert patched("<a>\n  <b/>\n</a>", lambda p: p.insert(p.root, NewElement("c"), last=True)) == "<a>\n  <b/>\n  <c/>\n</a>"
    assert patched("<a><b/></a>", lambda p: p.insert(p.root, new)) == '<a><c k="v"><d/></c><b/></a>'
    assert patched("<r>\n  <a/>\n</r>", lambda p: p.insert(p.root.find("a"), NewElement("c"))) == "<r>\n  <a>\n    <c/>\n  </a>\n</r>"
    assert patched("<r>\r\n  <a />\r\n</r>", lambda p: p.insert(p.root.find("a"), NewElement("c"))) == (
        "<r>\r\n  <a>\r\n    <c/>\r\n  </a>\r\n</r>"
    )
    assert patched("<a></a>", lambda p: p.insert(p.root, NewElement("c"), last=True)) == "<a><c/></a>"


def test_several_changes_to_one_element() -> None:
    def change(p: XmlPatch) -> None:
        p.set(p.root, x="1")
        p.insert(p.root, NewElement("c"))
        p.insert(p.root, NewElement("d"), last=True)
        p.set(p.root, y="2")

    assert patched("<a/>", change) == '<a x="1" y="2"><c/><d/></a>'
    assert patched("<a><b/></a>", change) == '<a x="1" y="2"><c/><b/><d/></a>'


def test_removal() -> None:
    text = "<a>\n  <!-- kept -->\n  <b>\n    text\n  </b>\n  <c/>\n</a>"
    assert patched(text, lambda p: p.remove(p.root.find("b"))) == "<a>\n  <!-- kept -->\n  <c/>\n</a>"


def test_comments_in_what_is_removed_stay() -> None:
    text = "<a>\n  <b>\n    <c/><!-- one -->\n    <!-- two\n lines -->\n  </b>\n</a>"
    assert patched(text, lambda p: p.remove(p.root.find("b"))) == "<a>\n  <!-- one -->\n  <!-- two\n lines -->\n</a>"


def test_what_surrounds_the_root_stays() -> None:
    text = '<?xml version="1.0"?>\n<!-- <robot> -->\n<a  q="1">é</a>\n<!-- after -->\n'
    assert patched(text, lambda p: p.set(p.root, q="2")) == text.replace('"1">é', '"2">é')


def test_errors() -> None:
    with pytest.raises(ConfigurationError, match="x: cannot be parsed"):
        XmlPatch(b"<a><b></a>", "x")
    with pytest.raises(ConfigurationError, match="UTF-16"):
        XmlPatch("<a/>".encode("utf-16"), "x")


names = st.sampled_from(["a", "b", "c", "ns:d"])
values = st.text(st.characters(codec="ascii", min_codepoint=32, exclude_characters="\x7f"), max_size=8)


@st.composite
def documents(draw: st.DrawFn, depth: int = 3) -> NewElement:
    children = draw(st.lists(documents(depth=depth - 1), max_size=3)) if depth else []
    return NewElement(draw(names), draw(st.dictionaries(st.sampled_from("xyz"), values, max_size=3)), children)


@given(documents(), values, st.sampled_from(["\n", ""]))
def test_the_meaning_is_that_of_the_change(document: NewElement, value: str, indent: str) -> None:
    """Against lxml: setting, adding and removing change just that, in any document."""
    text = document.text(indent)
    text = text.replace(f"<{document.tag}", f"<{document.tag} xmlns:ns='u'", 1)
    patch = XmlPatch(text.encode(), "x")
    wanted = etree.fromstring(text.encode())
    patch.set(patch.root, x=value)
    wanted.set("x", value)
    patch.insert(patch.root, NewElement("new", {"k": value}), last=True)
    if (first := next(iter(patch.root.children), None)) is not None:
        patch.remove(first)
        wanted.remove(wanted[0])
    wanted.append(etree.Element("new", k=value))
    found = etree.fromstring(patch.result())

    def plain(node: etree._Element) -> tuple[object, ...]:
        return (node.tag, dict(node.attrib), [plain(child) for child in node])

    assert plain(found) == plain(wanted)
