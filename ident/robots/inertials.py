"""The inertials of a URDF: what Pinocchio would take for nothing is refused, what no body can have is told."""

from __future__ import annotations

import math

import numpy as np
from lxml import etree

from ..errors import ConfigurationError

#: The numbers of an <inertial>, by element and attribute.
_NUMBERS = {"mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "origin": ("xyz", "rpy")}


def check_inertials(root: etree._Element, where: str) -> None:
    """Every number of an <inertial> is one: Pinocchio takes a link of which it cannot read them for one without mass.

    Raises ConfigurationError with the file, the link and the text."""
    for link in root.findall("link"):
        for tag, keys in _NUMBERS.items():
            element = link.find(f"inertial/{tag}")
            given = {} if element is None else {key: element.get(key) for key in keys}
            for key, text in given.items():
                for word in [] if text is None else text.split() or [text]:
                    if _is_plain(word):
                        continue
                    hint = "Write a point, not a comma." if "," in word else "Write the number alone, in kg, m and kg m^2."
                    raise ConfigurationError(
                        f"URDF {where}: link {link.get('name', '')!r}: <{tag} {key}={text!r}>: {word!r} is not a finite number. {hint}"
                    )


def link_faults(root: etree._Element) -> dict[str, str]:
    """Link → what no body can have: a negative mass, an inertia that some axis sees as negative. Other links are not among them."""
    found: dict[str, str] = {}
    for link in root.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        said = []
        if mass is not None and (kg := float(mass.get("value", "0"))) < 0:
            said.append(f"its mass is {kg:g} kg")
        if inertia is not None:
            xx, xy, xz, yy, yz, zz = (float(inertia.get(key, "0")) for key in _NUMBERS["inertia"])
            least = float(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0])
            if least < -1e-9 * max(abs(xx), abs(yy), abs(zz), abs(xy), abs(xz), abs(yz)):
                said.append(f"its inertia about some axis is {least:.4g} kg m^2 (ixx {xx:g}, iyy {yy:g}, izz {zz:g})")
        if said:
            found[link.get("name", "")] = " and ".join(said)
    return found


def _is_plain(word: str) -> bool:
    """Whether a word is a finite number as any program reads it."""
    try:
        return math.isfinite(float(word)) and "_" not in word
    except ValueError:
        return False
