"""What a judgement shows: how far each link is from one that a real body could be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.document import BlockKind, Figure, Layer, Panel, Role
from ..errors import UnsupportedError

if TYPE_CHECKING:
    import pandas as pd

    from .consistent import Consistent


def _lacks(links: Sequence[str], consistent: Consistent | None) -> np.ndarray:
    """Shortfall (links,) of the scaled pseudo-inertias; NaN where it was not judged."""
    if consistent is None:
        return np.full(len(links), np.nan)
    return np.array([consistent.shortfall.get(name, 0.0) for name in links])


def shortfall_frame(links: Sequence[str], consistent: Consistent | None) -> pd.DataFrame:
    """One row per moving link."""
    import pandas as pd

    lacks = _lacks(links, consistent)
    possible = [None if np.isnan(x) else bool(x <= 0.0) for x in lacks]
    return pd.DataFrame({"possible": possible, "lacks": lacks}, index=pd.Index(links, name="link"))


def shortfall_figure(links: Sequence[str], consistent: Consistent | None) -> Figure:
    """A mark for each moving link, at zero where a real body can have its parameters."""
    if consistent is None:
        raise UnsupportedError("physical consistency was not judged: the solver is not installed (pip install 'ident[sdp]').")
    lacks, at = 100 * _lacks(links, consistent), np.arange(len(links), dtype=float)
    layers = [
        Layer.of(BlockKind.MARKS, role, lacks[chosen], at[chosen], label=label)
        for role, label, chosen in ((Role.AFTER, "possible", lacks <= 0.0), (Role.BEFORE, "no real body", lacks > 0.0))
        if chosen.any()
    ]
    caption = "What a link's pseudo-inertia lacks to be that of a body with positive mass density, in per cent of its size; 0: nothing."
    return Figure(
        "consistency", "Links that a real body could be", caption, (Panel("", "lacks, % of its size", "", tuple(layers), tuple(links)),)
    )
