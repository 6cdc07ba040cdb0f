"""What each step of a step-by-step identification brought, for programs and for people."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .step_rows import StepRows

Array = np.ndarray
_WIDTH = 160


def told(step: StepRows, names: tuple[str, ...], new: Array, values: Array, std: Array, rank: int) -> dict[str, Any]:
    """What one step brought: the parameters that stand alone from here on (indices `new`), and the `rank` known after it.

    `values`, `std` (b,) as they stand after this step."""
    found = {names[i]: {"value": float(values[i]), "std": float(std[i])} for i in new}
    return {"test": step.name, "kind": step.kind, "row": step.row, "rows": len(step.torque), "revealed": found, "known": rank}


def steps_text(steps: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> str:
    """A table of the steps: test, the torque it reads, its rows, how many combinations are known after it, and what it revealed."""
    total = max((int(s["known"]) for s in steps), default=0)
    width = max((len(s["test"]) for s in steps), default=4)
    row_width = max((len(s["row"]) for s in steps), default=4)
    lines = [f"{'step':>4}  {'test':<{width}}  {'reads':<{row_width}}  {'rows':>5}  {'known':>7}  found in this step (value ± std)"]
    for number, step in enumerate(steps, start=1):
        head = f"{number:>4}  {step['test']:<{width}}  {step['row']:<{row_width}}  {step['rows']:>5}  {step['known']:>3}/{total:<3}  "
        revealed = step["revealed"].items()
        found = ", ".join(f"{name} {v['value']:.4g} ± {v['std']:.2g} {units.get(name, '')}".rstrip() for name, v in revealed)
        text = found or ("in combination with others" if number == 1 or step["known"] > steps[number - 2]["known"] else "nothing new")
        lines += textwrap.wrap(head + text, _WIDTH, subsequent_indent=" " * len(head), break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines)
