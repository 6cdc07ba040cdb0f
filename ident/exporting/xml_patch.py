"""Changing an XML file where it stands: attributes, added and removed elements; every other byte stays as it was.

A parser that writes the document anew keeps its meaning, but not its layout (line breaks between attributes, quotes, what precedes
the root). Here the parser only says where the elements are, and the text is cut and joined at those places."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from ..errors import ConfigurationError


@dataclass(eq=False)
class Element:
    """An element and its bytes: [start, open_end) is the start tag, [close_start, end) the end tag (empty for `<a/>`)."""

    tag: str
    attributes: dict[str, str]
    parent: Element | None
    start: int
    open_end: int
    close_start: int = 0
    end: int = 0
    children: list[Element] = field(default_factory=list)

    @property
    def empty(self) -> bool:
        """Written as one tag, `<a/>`."""
        return self.close_start == self.end

    def get(self, name: str, default: str = "") -> str:
        """An attribute's value, entities resolved."""
        return self.attributes.get(name, default)

    def find(self, tag: str) -> Element | None:
        """First child of that name."""
        return next(self.findall(tag), None)

    def findall(self, tag: str) -> Iterator[Element]:
        """Children of that name."""
        return (child for child in self.children if child.tag == tag)


@dataclass(frozen=True)
class NewElement:
    """An element to be added."""

    tag: str
    attributes: Mapping[str, str] = field(default_factory=dict)
    children: Sequence[NewElement] = ()

    def text(self, indent: str) -> str:
        """Its text; `indent` is the line break and white space before it."""
        opening = "".join((f"<{self.tag}", *(f" {name}={quoteattr(value)}" for name, value in self.attributes.items())))
        if not self.children:
            return opening + "/>"
        inner = indent + "  " if "\n" in indent else indent
        return "".join((opening, ">", *(inner + child.text(inner) for child in self.children), indent, f"</{self.tag}>"))


class XmlPatch:
    """An XML document with changes that `result` makes. Raises ConfigurationError (naming `where`) for text that does not parse."""

    def __init__(self, data: bytes, where: str) -> None:
        self.data = data
        self.root = _parse(data, where)
        self._attributes: dict[Element, dict[str, str]] = {}
        self._first: dict[Element, list[NewElement]] = {}
        self._last: dict[Element, list[NewElement]] = {}
        self._removed: list[Element] = []

    def set(self, element: Element, **attributes: str) -> None:
        """Give an element attributes."""
        self._attributes.setdefault(element, {}).update(attributes)

    def insert(self, parent: Element, child: NewElement, *, last: bool = False) -> None:
        """Add a child, before the others or after them, indented like them."""
        (self._last if last else self._first).setdefault(parent, []).append(child)

    def remove(self, element: Element) -> None:
        """Take an element out, with the white space before it; comments inside it stay where it was."""
        self._removed.append(element)

    def result(self) -> bytes:
        """The document with all changes."""
        cuts: list[tuple[int, int, bytes]] = []
        for element in {**self._attributes, **self._first, **self._last}:
            tag = self.data[element.start : element.open_end]
            for name, value in self._attributes.get(element, {}).items():
                tag = _with_attribute(tag, name, value)
            indent = self._indent(element)
            first = "".join(indent + child.text(indent) for child in self._first.get(element, ()))
            last = "".join(indent + child.text(indent) for child in self._last.get(element, ()))
            if element.empty and (first or last):
                tag = re.sub(rb"\s*/>$", b">", tag) + self._bytes(first + last + self._before(element) + f"</{element.tag}>")
                first = last = ""
            cuts.append((element.start, element.open_end, tag + self._bytes(first)))
            if last:
                # After the last child, before the white space that precedes the end tag.
                place = element.children[-1].end if element.children else element.open_end
                cuts.append((place, place, self._bytes(last)))
        for element in self._removed:
            start = element.start - (len(self.data[: element.start]) - len(self.data[: element.start].rstrip()))
            comments = re.findall(rb"<!--.*?-->", self.data[element.start : element.end], re.DOTALL)
            cuts.append((start, element.end, b"".join(self.data[start : element.start] + comment for comment in comments)))
        out = self.data
        for start, end, text in sorted(cuts, key=lambda cut: cut[:2], reverse=True):
            out = out[:start] + text + out[end:]
        return out

    def _bytes(self, text: str) -> bytes:
        # New text is ASCII but for names, which are in the document's own encoding already.
        return text.replace("\n", "\r\n").encode() if b"\r\n" in self.data else text.encode()

    def _before(self, element: Element) -> str:
        """Line break and white space before an element, or nothing where it does not start a line."""
        before = self.data[: element.start]
        space = before[len(before.rstrip()) :].decode().replace("\r\n", "\n")
        return space[space.rfind("\n") :] if "\n" in space else ""

    def _indent(self, parent: Element) -> str:
        """Line break and white space before a child of `parent`."""
        if parent.children:
            return self._before(parent.children[0])
        own = self._before(parent)
        return own + "  " if own else ""


def _with_attribute(tag: bytes, name: str, value: str) -> bytes:
    """A start tag with an attribute set in place, or added at its end."""
    quoted = quoteattr(value).encode()
    pattern = re.compile(rb"(\s" + re.escape(name.encode()) + rb"\s*=\s*)(\"[^\"]*\"|'[^']*')")
    if pattern.search(tag):
        return pattern.sub(lambda found: found.group(1) + quoted, tag, count=1)
    body = re.sub(rb"\s*/?>$", b"", tag)
    return body + b" " + name.encode() + b"=" + quoted + tag[len(body) :].lstrip()


def _parse(data: bytes, where: str) -> Element:
    """The tree of elements with their places in `data`."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or data[:4] == b"<\x00?\x00":
        raise ConfigurationError(f"{where}: it is encoded in UTF-16, which cannot be changed in place; save it as UTF-8.")
    parser = expat.ParserCreate()
    stack: list[Element] = []
    roots: list[Element] = []

    def opened(tag: str, attributes: dict[str, str]) -> None:
        start = parser.CurrentByteIndex
        element = Element(tag, dict(attributes), stack[-1] if stack else None, start, _tag_end(data, start))
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def closed(_: str) -> None:
        element = stack.pop()
        if data[element.open_end - 2 : element.open_end] == b"/>":
            element.close_start = element.end = element.open_end
        else:
            element.close_start = parser.CurrentByteIndex
            element.end = data.index(b">", element.close_start) + 1

    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ConfigurationError(f"{where}: cannot be parsed: {error}.") from None
    return roots[0]


def _tag_end(data: bytes, start: int) -> int:
    """End of the start tag at `start`: the first `>` outside quotes."""
    found = re.compile(rb"<(?:[^>\"']|\"[^\"]*\"|'[^']*')*>").match(data, start)
    assert found is not None
    return found.end()
