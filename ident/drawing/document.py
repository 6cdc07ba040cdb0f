"""A report as plain data: sections of text, tables and figures, in an order. Whatever makes one needs no drawing library, and it can
be kept as JSON and drawn again later."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from .._utils.fields import Field
from .._utils.json import jsonable
from .._utils.structured import read_json
from ..errors import ConfigurationError

Array = np.ndarray
SCHEMA = "ident.report/1"
#: Significant digits of the numbers that figures are drawn from.
_DIGITS = 5
#: Names of figures, which become names of files, and panels side by side at the most.
_FILE = re.compile(r"[\w-]{1,80}")
_MOST_COLUMNS = 12


class Role(StrEnum):
    """What a layer shows: decides its colour everywhere."""

    BEFORE = "before"
    AFTER = "after"
    EFFECT = "effect"
    FLOOR = "floor"
    MEASURED = "measured"


class BlockKind(StrEnum):
    """How a layer is drawn. POINTS: a cloud of many; MARKS: a few, each to be seen; BAND: between `y` and `upper`; SPAN: between x[0] and
    x[1] over the whole height; CELLS: a square at each (x, y), coloured by `upper` from -1 to 1."""

    LINE = "line"
    POINTS = "points"
    MARKS = "marks"
    BAND = "band"
    SPAN = "span"
    CELLS = "cells"


@dataclass(frozen=True)
class Layer:
    """One thing in a panel: x and y (and `upper` of a band); None where a line breaks."""

    kind: BlockKind
    role: Role
    x: tuple[float | None, ...]
    y: tuple[float | None, ...] = ()
    upper: tuple[float | None, ...] = ()
    label: str = ""

    @classmethod
    def of(cls, kind: BlockKind, role: Role, x: Any, y: Any = (), upper: Any = (), label: str = "") -> Layer:
        """From arrays; what is not finite becomes a break."""
        return cls(kind, role, _rounded(x), _rounded(y), _rounded(upper), label)


@dataclass(frozen=True)
class Panel:
    """One pair of axes. `names`: what stands at y = 0, 1, 2 … from above, where y counts things. `to_scale`: a length is as long in x
    as in y."""

    title: str
    x_label: str
    y_label: str
    layers: tuple[Layer, ...]
    names: tuple[str, ...] = ()
    to_scale: bool = False


@dataclass(frozen=True)
class Figure:
    """Panels in rows of `columns`; `name` is that of its file, `caption` says what is to be seen."""

    name: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 1


@dataclass(frozen=True)
class Table:
    """`rows` of texts under `head`; the first `left` columns are words (left aligned), the others numbers."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    left: int = 1


@dataclass(frozen=True)
class Text:
    """A section of words."""

    title: str
    lines: tuple[str, ...]


Section = Text | Table | Figure
_SECTIONS: dict[str, type[Text] | type[Table] | type[Figure]] = {"text": Text, "table": Table, "figure": Figure}


@dataclass(frozen=True)
class Report:
    """`headline` is the answer, in one line; `kind` names it in a word ("clean", "changed" …); `subject` says of what."""

    headline: str
    kind: str
    subject: str
    sections: tuple[Section, ...]

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Its figures, in order."""
        return tuple(s for s in self.sections if isinstance(s, Figure))

    def to_dict(self) -> dict[str, Any]:
        """JSON form, from which `read_report` makes it again."""
        kinds = {cls: name for name, cls in _SECTIONS.items()}
        return {
            "schema": SCHEMA,
            "headline": self.headline,
            "kind": self.kind,
            "subject": self.subject,
            "sections": [{"section": kinds[type(s)], **jsonable(dataclasses.asdict(s))} for s in self.sections],
        }

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(self.to_dict(), separators=(",", ":")) + "\n"


def read_report(path: Path) -> Report:
    """A report that was kept as JSON. Raises ConfigurationError for anything else."""
    data = Field(read_json(path, "report"), f"report {path}")
    if "schema" not in data or data["schema"].value != SCHEMA:
        raise ConfigurationError(f"report {path}: is not a kept report ({SCHEMA}).")
    return _report(data)


def _report(data: Field) -> Report:
    return Report(
        data["headline"].text(), data["kind"].text(), data["subject"].text(), tuple(_section(s) for s in data["sections"].items())
    )


def _section(data: Field) -> Section:
    kind = data["section"].one_of(_SECTIONS)
    title = data["title"].text()
    if kind == "text":
        return Text(title, data["lines"].texts())
    if kind == "table":
        head = data["head"].texts()
        rows = tuple(tuple(c.text() for c in row.items(len(head))) for row in data["rows"].items())
        return Table(title, head, rows, data["note"].text(), data["left"].whole(0, max(len(head), 1)))
    panels = tuple(
        Panel(
            p["title"].text(), p["x_label"].text(), p["y_label"].text(), tuple(map(_layer, p["layers"].items())),
            p["names"].texts() if "names" in p else (), "to_scale" in p and p["to_scale"].value is True,
        )
        for p in data["panels"].items()
    )  # fmt: skip
    name = data["name"].text()
    if not _FILE.fullmatch(name):  # it becomes the name of a file
        raise data["name"].fault("letters, digits, - and _")
    return Figure(name, title, data["caption"].text(), panels, data["columns"].whole(1, _MOST_COLUMNS))


def _layer(data: Field) -> Layer:
    kind, role = BlockKind(data["kind"].one_of(BlockKind)), Role(data["role"].one_of(Role))
    x, y, upper = (_finite(v.number(absent=True) for v in data[key].items()) for key in ("x", "y", "upper"))
    wanted = {BlockKind.SPAN: (2, len(y), len(upper)), BlockKind.BAND: (len(x),) * 3, BlockKind.CELLS: (len(x),) * 3}.get(
        kind, (len(x), len(x), len(upper))
    )
    if (len(x), len(y), len(upper)) != wanted:
        raise data.fault(f"a layer of one length ({kind})")
    return Layer(kind, role, x, y, upper, data["label"].text())


def _finite(values: Iterable[float]) -> tuple[float | None, ...]:
    return tuple(v if math.isfinite(v) else None for v in values)


def _rounded(values: Any) -> tuple[float | None, ...]:
    return tuple(float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in np.asarray(values, float).tolist())


def uncertain(value: float, std: float) -> str:
    """`value ± std` with as many digits as the std bears."""
    if not math.isfinite(std) or std <= 0:
        return f"{value:.5g}"
    place = math.floor(math.log10(std))
    digits = 1 - place
    if abs(value) >= 1e5 or place < -6 or place > 4:
        return f"{value:.4g} ± {std:.2g}"
    return f"{round(value, digits):.{max(0, digits)}f} ± {round(std, digits):.{max(0, digits)}f}"


def percent(share: float, digits: int = 2) -> str:
    """A share in per cent; a dash where there is none."""
    return f"{100 * share:.{digits}f}" if math.isfinite(share) else "–"


def plain(number: float, digits: int = 3) -> str:
    """A number for a table; a dash where there is none."""
    return f"{number:.{digits}g}" if math.isfinite(number) else "–"


def joined(names: Iterable[str]) -> str:
    """Names in a row."""
    return ", ".join(names)
