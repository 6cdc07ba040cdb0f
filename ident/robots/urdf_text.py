"""From the bytes of a URDF to its elements: one decoder, no document type, only the parts that identification reads."""

from __future__ import annotations

import codecs
import re

from lxml import etree

from ..errors import ConfigurationError

_DECLARATION = re.compile(r"^\s*<\?xml[^>]*\?>")
_ENCODING = re.compile(rb"""^\s*<\?xml[^>]*encoding=["']([A-Za-z0-9._-]+)["']""")
_PREFIX = re.compile(r"Namespace prefix ([\w.-]+)")
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
#: Undeclared prefixes that are declared for the writer, one after the other.
_PREFIXES = 50
#: Parts of a link that identification does not read.
_UNREAD = ("visual", "collision", "sensor", "material")


def decoded(data: bytes | str, where: str) -> str:
    """The text of a URDF, as its byte order mark or its declaration says; UTF-8 without either.

    Raises ConfigurationError: bytes that are no text in that encoding, a document type or an entity."""
    if isinstance(data, str):
        return _settled(data, where)
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if encoding is None:
        declared = _ENCODING.match(data[:300])
        encoding = declared.group(1).decode() if declared else "utf-8"
    try:
        text = data.decode(encoding)
    except (UnicodeDecodeError, LookupError):
        raise ConfigurationError(f"URDF {where}: is not text in the encoding {encoding!r}. Save it as UTF-8.") from None
    return _settled(text, where)


def _settled(text: str, where: str) -> str:
    """The text without its declaration. Raises ConfigurationError for a document type or an entity."""
    text = _DECLARATION.sub("", text.lstrip("\ufeff"), count=1).strip("\ufeff \t\r\n")
    if re.search(r"<!(DOCTYPE|ENTITY)", text):
        raise ConfigurationError(f"URDF {where}: declares a document type or an entity. Remove <!DOCTYPE …>, and expand the entities.")
    return text


def parsed(text: str, where: str, notes: list[str]) -> etree._Element:
    """The root element. Prefixes that the file does not declare are declared for it, and noted. Raises ConfigurationError."""
    parser = etree.XMLParser(remove_comments=True, remove_pis=True, resolve_entities=False, no_network=True)
    found: list[str] = []
    for _ in range(_PREFIXES):
        try:
            root = etree.fromstring(text, parser)
        except etree.XMLSyntaxError as error:
            missing = _PREFIX.search(error.msg or "")
            if missing is None or missing.group(1) in found:
                raise ConfigurationError(f"URDF {where}: cannot be parsed: {error.msg}.") from None
            found.append(missing.group(1))
            declaration = f' xmlns:{missing.group(1)}="urn:undeclared:{missing.group(1)}"'
            text = re.sub(r"(<[A-Za-z_][\w.:-]*)", rf"\1{declaration}", text, count=1)
            continue
        except ValueError as error:
            raise ConfigurationError(f"URDF {where}: cannot be parsed: {error}.") from None
        if found:
            notes.append(f"the file does not declare the prefix {', '.join(found)}: taken as declared.")
        return root
    raise ConfigurationError(f"URDF {where}: cannot be parsed: more than {_PREFIXES} prefixes are not declared.")


def settle_elements(root: etree._Element, where: str, notes: list[str]) -> None:
    """Keep the links and joints, without what is seen or touched; plain names for what a default namespace named otherwise.

    Raises ConfigurationError where a xacro macro is left that could hold a link, a joint or an inertial."""
    left = 0
    for child in list(root):
        if _is_xacro(child):
            raise _template(where)
        if etree.QName(child).localname not in ("link", "joint"):
            root.remove(child)
            continue
        for part in list(child):
            if etree.QName(part).localname in _UNREAD and not _is_xacro(part):
                left += sum(_is_xacro(e) for e in part.iter(etree.Element))
                child.remove(part)
    for element in root.iter(etree.Element):
        if _is_xacro(element) or any("${" in v or "$(" in v for v in element.attrib.values()):
            raise _template(where)
        element.tag = etree.QName(element).localname
    if left:
        notes.append(f"{left} macro{'s' if left > 1 else ''} of xacro left in visuals or collisions: ignored here.")


def _is_xacro(element: etree._Element) -> bool:
    return "xacro" in (etree.QName(element).namespace or "")


def _template(where: str) -> ConfigurationError:
    return ConfigurationError(f"URDF {where}: is a xacro template. Expand it first (`xacro FILE > robot.urdf`) and give the result.")
