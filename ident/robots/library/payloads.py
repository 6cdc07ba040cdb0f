"""Payloads that a built-in robot offers: the same URDF with another inertial on one link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from ..._utils.toml import Unfit, check_table, number, numbers, text
from ...errors import ConfigurationError, unknown_name

Array = np.ndarray


@dataclass(frozen=True)
class Body:
    """A rigid body: mass (kg), centre of mass `com` (3,) (m) in the link frame, and the inertia about the centre of mass
    in the link frame's directions (kg m²): Ixx, Ixy, Ixz, Iyy, Iyz, Izz as elements of the matrix."""

    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...]

    @classmethod
    def about_origin(cls, mass: float, com: tuple[float, ...], inertia: tuple[float, ...]) -> Body:
        """A body whose inertia is given about the origin of the link frame."""
        c = np.array(com)
        steiner = mass * (c @ c * np.eye(3) - np.outer(c, c))
        return cls(mass, com, tuple((np.array(inertia) - steiner[np.triu_indices(3)]).tolist()))

    def matrix(self) -> Array:
        """Inertia about the centre of mass, (3, 3)."""
        xx, xy, xz, yy, yz, zz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def __add__(self, other: Body) -> Body:
        """Both bodies rigidly joined."""
        mass = self.mass + other.mass
        com = (self.mass * np.array(self.com) + other.mass * np.array(other.com)) / mass
        inertia = np.zeros((3, 3))
        for body in (self, other):
            d = np.array(body.com) - com
            inertia += body.matrix() + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
        return Body(mass, tuple(com.tolist()), tuple(inertia[np.triu_indices(3)].tolist()))


@dataclass(frozen=True)
class PayloadData:
    """A choice of what a link carries. `replace`: the link's own body instead of the URDF's; `add`: a body beside it;
    `on`: the choice it starts from (else the URDF)."""

    name: str
    description: str
    link: str = ""
    on: str | None = None
    replace: Body | None = None
    add: Body | None = None


def _body(value: Any) -> Body:
    expected = (
        "a table { mass = kg, com = [x, y, z], inertia = [Ixx, Ixy, Ixz, Iyy, Iyz, Izz] } (inertia_at_origin: about the link's origin)"
    )
    keys = {"mass": number, "com": numbers(3), "inertia": numbers(6), "inertia_at_origin": numbers(6)}
    if not isinstance(value, Mapping) or set(value) not in ({"mass", "com", "inertia"}, {"mass", "com", "inertia_at_origin"}):
        raise Unfit(expected)
    given = {key: kind(value[key]) for key, kind in keys.items() if key in value}
    return Body.about_origin(*given.values()) if "inertia_at_origin" in given else Body(**given)


def read_payloads(data: Any, where: str) -> dict[str, PayloadData]:
    """The `[payload.*]` tables of a robot file."""
    schema = {"description": text, "link": text, "on": text, "replace": _body, "add": _body}
    found = {}
    for name, table in data.items():
        values = check_table(table, schema, f"payload.{name}", where)
        found[name] = PayloadData(name, values.pop("description", ""), **values)
        if found[name].on is not None and found[name].on not in data:
            raise unknown_name(f"payload ({where}, [payload.{name}] on)", str(found[name].on), data)
    return found


def with_payload(urdf: Path, name: str, offered: Mapping[str, PayloadData]) -> str | Path:
    """URDF text with one payload put in; the file itself where the payload changes nothing."""
    steps = [offered[name]]
    while steps[0].on is not None:
        steps.insert(0, offered[steps[0].on])
        if len(steps) > len(offered):
            raise ConfigurationError(f"payload {name!r} builds on itself.")
    if all(step.replace is None and step.add is None for step in steps):
        return urdf
    root = etree.fromstring(urdf.read_bytes())
    for step in steps:
        link = next((e for e in root.findall("link") if e.get("name") == step.link), None)
        if link is None:
            raise unknown_name(f"link in [payload.{step.name}]", step.link, [e.get("name", "") for e in root.findall("link")])
        if step.replace is not None:
            _write(link, step.replace)
        if step.add is not None:
            _write(link, _read(link) + step.add)
    return etree.tostring(root, encoding="unicode")


def _read(link: etree._Element) -> Body:
    inertial = link.find("inertial")
    origin, inertia = inertial.find("origin"), inertial.find("inertia")
    if any(float(word) for word in origin.get("rpy", "0 0 0").split()):
        raise ConfigurationError(f"link {link.get('name')!r}: a payload needs an inertial whose axes are those of the link (rpy 0 0 0).")
    return Body(
        float(inertial.find("mass").get("value")),
        tuple(float(word) for word in origin.get("xyz", "0 0 0").split()),
        tuple(float(inertia.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
    )


def _write(link: etree._Element, body: Body) -> None:
    old = link.find("inertial")
    if old is not None:
        link.remove(old)
    inertial = etree.Element("inertial")
    link.insert(0, inertial)
    etree.SubElement(inertial, "origin", xyz=" ".join(map(repr, body.com)), rpy="0 0 0")
    etree.SubElement(inertial, "mass", value=repr(body.mass))
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    etree.SubElement(inertial, "inertia", **{key: repr(v) for key, v in zip(keys, body.inertia, strict=True)})
