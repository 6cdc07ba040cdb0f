"""What a log shows: a table by the names of our own format, and position and torque over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted
from ..drawing.document import BlockKind, Figure, Layer, Panel, Role

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray
#: Points of a line.
_POINTS = 2000
#: Side of a torque → key of its columns, and what it is called.
TORQUE = {"joint": ("tau", "torque (N m, N)"), "motor": ("tau_m", "motor torque (N m, N)"), "current": ("i", "current (A)")}


def log_frame(t: Array, arrays: Mapping[str, Array | None], extra: Mapping[str, Array]) -> pd.DataFrame:
    """Time (N,), the columns of arrays (N, n) numbered by joint, and the further columns; what is nowhere a number is left out."""
    import pandas as pd

    table: dict[str, Array] = {"t": t}
    for key, values in arrays.items():
        if values is not None:
            table |= {f"{key}{j + 1}": own for j, own in enumerate(values.T) if not np.isnan(own).all()}
    table |= {name: values for name, values in extra.items() if name not in table}
    return pd.DataFrame(table)


def log_figure(name: str, t: Array, kinds: Sequence[tuple[str, Array]]) -> Figure:
    """For each joint a panel for each kind of quantity (label, values (N, n)), side by side."""
    keep = np.unique(np.linspace(0, len(t) - 1, min(len(t), _POINTS)).astype(int))
    n = kinds[0][1].shape[1]
    panels = []
    for j in range(n):
        for (label, values), role in zip(kinds, (Role.AFTER, Role.MEASURED), strict=False):
            layer = Layer.of(BlockKind.LINE, role, t[keep], values[keep, j])
            panels.append(Panel(f"joint {j + 1}", "time (s)" if j == n - 1 else "", label, (layer,)))
    return Figure("log", f"Log {name}", f"{counted(len(t), 'sample')} as recorded.", tuple(panels), columns=len(kinds))
