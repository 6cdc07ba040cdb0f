"""The table of targets: what was measured, against what, what was asked for, met or by how much not, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """`measured` in `unit` against a `target` (largest that counts as met) if there is one; `others`: (who, their value in the same unit,
    least ratio asked for or None); `why`: what limits it, shown where something is missed; `note`: shown always."""

    work: str
    measured: float
    unit: str
    target: float | None = None
    others: tuple[tuple[str, float, float | None], ...] = ()
    why: str = ""
    note: str = ""

    @property
    def misses(self) -> list[str]:
        """What was asked for and is not there."""
        out = []
        if not self.measured > 0:
            return ["not measured"]
        if self.target is not None and self.measured > self.target:
            out.append(f"missed by {self.measured / self.target - 1:.0%}")
        for who, theirs, least in self.others:
            if least is not None and theirs / self.measured < least:
                out.append(f"{theirs / self.measured:.3g} x {who}, asked {least:g} x")
        return out

    def lines(self) -> list[str]:
        """The row in words."""
        asked = "" if self.target is None else f"; target {self.target:g} {self.unit}"
        head = f"{self.work}: {self.measured:.3g} {self.unit}{asked}"
        judged = self.target is not None or any(least is not None for _, _, least in self.others)
        misses = self.misses
        head += "" if not judged else ": " + ("met" if not misses else "; ".join(misses))
        out = [head]
        for who, theirs, least in self.others:
            out.append(
                f"    {theirs / self.measured:.3g} x {who} ({theirs:.3g} {self.unit})" + ("" if least is None else f", asked {least:g} x")
            )
        if misses and self.why:
            out.append(f"    why: {self.why}")
        if self.note:
            out.append(f"    {self.note}")
        return out

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "misses": self.misses}


def show_rows(rows: Sequence[Row]) -> None:
    """All rows on standard output."""
    for row in rows:
        print("\n".join(row.lines()), flush=True)


def show(title: str, table: Sequence[dict[str, Any]]) -> None:
    """A table of equal records on standard output."""
    if not table:
        return
    print(f"\n{title}")
    names = list(table[0])
    cells = [names, *([f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()] for row in table)]
    widths = [max(len(row[c]) for row in cells) for c in range(len(names))]
    for row in cells:
        print("  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)), flush=True)
