"""Pieces of the Python files that some targets are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from .._utils.version import __version__

if TYPE_CHECKING:
    from .identified import Identified


def header(found: Identified, title: str, notes: Iterable[str]) -> str:
    """The docstring of a written file: what it is, and what it leaves out."""
    lines = [f'"""{title}: {found.robot.name}, written by ident {__version__}.', "", "Joint side, SI units (N m, rad, kg m^2; N, m, kg)."]
    lines += [f"- {_plain(note)}" for note in notes]
    return "\n".join([*lines, '"""', ""])


def _plain(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"""', "'''")


def table(values: Mapping[str, float], indent: str = "    ") -> str:
    """A dictionary of numbers, one line for each joint."""
    rows = "".join(f"{indent}    {name!r}: {value!r},\n" for name, value in values.items())
    return "{\n" + rows + indent + "}"


def alike(values: Mapping[str, float]) -> bool:
    """Whether all joints have the same number."""
    return len(set(values.values())) <= 1
