"""A report as plain data: sections of text, tables and figures, in an order. Whatever makes one needs no drawing library, and it can
be kept as JSON and drawn again later."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from .._utils.json import jsonable
from ..errors import ConfigurationError

Array = np.ndarray
SCHEMA = "ident.report/1"
#: Significant digits of the numbers that figures are drawn from.
_DIGITS = 5


class Role(StrEnum):
    """What a layer shows: decides its colour everywhere."""

    BEFORE = "before"
    AFTER = "after"
    EFFECT = "effect"
    FLOOR = "floor"
    MEASURED = "measured"


class BlockKind(StrEnum):
    """How a layer is drawn. BAND: between `y` and `upper`; SPAN: between x[0] and x[1] over the whole height."""

    LINE = "line"
    POINTS = "points"
    BAND = "band"
    SPAN = "span"


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
    """One pair of axes."""

    title: str
    x_label: str
    y_label: str
    layers: tuple[Layer, ...]


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
        """JSON form, from which `from_dict` makes it again."""
        kinds = {cls: name for name, cls in _SECTIONS.items()}
        return {
            "schema": SCHEMA,
            "headline": self.headline,
            "kind": self.kind,
            "subject": self.subject,
            "sections": [{"section": kinds[type(s)], **jsonable(dataclasses.asdict(s))} for s in self.sections],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Report:
        """From `to_dict`. Raises KeyError, TypeError or ValueError for anything else."""
        return cls(data["headline"], data["kind"], data["subject"], tuple(_section(s) for s in data["sections"]))

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(self.to_dict(), separators=(",", ":")) + "\n"


def read_report(path: Path) -> Report:
    """A report that was kept as JSON. Raises ConfigurationError for anything else."""
    try:
        data = json.loads(path.read_text())
        if data["schema"] != SCHEMA:
            raise KeyError("schema")
        return Report.from_dict(data)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"report {path}: cannot be read ({error}).") from None
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise ConfigurationError(f"report {path}: is not a kept report ({SCHEMA}): {type(error).__name__}: {error}.") from None


def _section(data: Mapping[str, Any]) -> Section:
    values = {k: v for k, v in data.items() if k != "section"}
    kind = _SECTIONS[data["section"]]
    if kind is Figure:
        values["panels"] = tuple(
            Panel(p["title"], p["x_label"], p["y_label"], tuple(_layer(layer) for layer in p["layers"])) for p in values["panels"]
        )
    elif kind is Table:
        values["head"], values["rows"] = tuple(values["head"]), tuple(tuple(row) for row in values["rows"])
    else:
        values["lines"] = tuple(values["lines"])
    return kind(**values)


def _layer(data: Mapping[str, Any]) -> Layer:
    x, y, upper = (tuple(data[k]) for k in ("x", "y", "upper"))
    return Layer(BlockKind(data["kind"]), Role(data["role"]), x, y, upper, data["label"])


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
