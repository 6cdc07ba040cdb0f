"""The inertials of a URDF: what Pinocchio would take for nothing is refused, what no body can have is told."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from lxml import etree

from ..errors import ConfigurationError

#: Share by which written digits may break the triangle inequality of a flat body.
_ROUNDED = 0.01
#: kg m²: below it, an inertia is what arithmetic left of zero.
_NO_INERTIA = 1e-12
#: Below this, a number is written as zero.
_NOTHING = 1e-290
#: The numbers of an <inertial>, by element and attribute, and the largest that a robot could have (kg, kg m^2, m): beyond, sums overflow.
_MOST = {"mass": 1e9, "inertia": 1e15, "origin": 1e3}
_NUMBERS = {"mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "origin": ("xyz", "rpy")}


def check_inertials(root: etree._Element, where: str) -> None:
    """Every number of an <inertial> is one: Pinocchio takes a link of which it cannot read them for one without mass.

    Raises ConfigurationError with the file, the link and the text."""
    for link in root.findall("link"):
        _check_whole(link, where)
        for tag, keys in _NUMBERS.items():
            element = link.find(f"inertial/{tag}")
            given = {} if element is None else {key: element.get(key) for key in keys}
            for key, text in given.items():
                if text is None or element is None:
                    continue
                words = text.split() or [text]
                if len(words) != (3 if tag == "origin" else 1):
                    raise ConfigurationError(
                        f"URDF {where}: link {link.get('name', '')!r}: <{tag} {key}={text!r}>:"
                        f" {'three numbers are' if tag == 'origin' else 'one number is'} needed."
                    )
                for word in words:
                    if abs(plain_number(word)) <= _MOST[tag]:
                        continue
                    if math.isfinite(plain_number(word)):
                        raise ConfigurationError(
                            f"URDF {where}: link {link.get('name', '')!r}: <{tag} {key}={text!r}> is not plausible for a robot."
                        )
                    hint = "Use a decimal point, not a comma." if "," in word else "Write only the number, in kg, m or kg m^2."
                    raise ConfigurationError(
                        f"URDF {where}: link {link.get('name', '')!r}: <{tag} {key}={text!r}>: {word!r} is not a finite number. {hint}"
                    )
                element.set(key, written(map(plain_number, words)))


def written(numbers: Iterable[float]) -> str:
    """Numbers anew, so that Pinocchio reads those that were checked: its parser takes some that are nearly nothing for an error."""
    return " ".join(repr(0.0 if abs(x) < _NOTHING else x) for x in numbers)


def _check_whole(link: etree._Element, where: str) -> None:
    """An <inertial> has its mass and all six moments, or it is not there: half of one would count as zero."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None and inertia is None:
        link.remove(inertial)
        return
    missing = ["<mass value=…>"] if mass is None or mass.get("value") is None else []
    given: dict[str, str] = {} if inertia is None else {str(k): str(v) for k, v in inertia.attrib.items()}
    missing += [f"<inertia {key}=…>" for key in _NUMBERS["inertia"] if key not in given]
    if missing:
        raise ConfigurationError(
            f"URDF {where}: link {link.get('name', '')!r}: its <inertial> lacks {', '.join(missing)}. Complete it, or remove it."
        )


def link_oddities(root: etree._Element) -> dict[str, str]:
    """Link → principal moments of which one exceeds the sum of the others, though none is negative: no distribution of mass has them."""
    found: dict[str, str] = {}
    for link in root.findall("link"):
        inertia = link.find("inertial/inertia")
        if inertia is None:
            continue
        xx, xy, xz, yy, yz, zz = (float(inertia.get(key, "0")) for key in _NUMBERS["inertia"])
        low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if low >= 0 and high > (low + middle) * (1.0 + _ROUNDED) + _NO_INERTIA:
            found[link.get("name", "")] = (
                f"its principal moment {high:.4g} kg m^2 exceeds the sum of the others"
                f" ({low:.4g} + {middle:.4g}; ixx {xx:g}, iyy {yy:g}, izz {zz:g})"
            )
    return found


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
            if least < -1e-9 * max(abs(xx), abs(yy), abs(zz), abs(xy), abs(xz), abs(yz)) - _NO_INERTIA:
                said.append(f"its inertia about some axis is {least:.4g} kg m^2 (ixx {xx:g}, iyy {yy:g}, izz {zz:g})")
        if said:
            found[link.get("name", "")] = " and ".join(said)
    return found


def plain_number(word: str) -> float:
    """The number that any program reads in a word; NaN where it is none (`1_0` and digits of other scripts are numbers to Python alone)."""
    try:
        return float(word) if word.isascii() and "_" not in word else math.nan
    except ValueError:
        return math.nan
