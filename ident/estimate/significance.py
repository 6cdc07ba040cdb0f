"""Which parameters of an estimate carry no weight: intervals that cover zero, deviations that are large beside the value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .record import EstimateRecord

#: Relative standard deviation beyond which a value says little, and half the width of a 95 % interval in standard deviations.
LARGEST = 0.30
_HALF = 1.959964


@dataclass(frozen=True)
class Insignificant:
    """A parameter that the data hardly show: `relative` standard deviation, and whether its 95 % interval covers zero."""

    name: str
    relative: float
    covers_zero: bool


def insignificant(estimate: EstimateRecord) -> tuple[Insignificant, ...]:
    """Base parameters whose 95 % interval covers zero or whose standard deviation exceeds 30 % of the value, the worst first.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> from ident.estimate.significance import insignificant
    >>> len(insignificant(ident.fit(train, "puma560", held=0))) < 26
    True
    """
    std, size = estimate.std, np.abs(estimate.values)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(std > 0, std / size, 0.0)
    found = [
        Insignificant(name, float(share), bool(share * _HALF >= 1.0))
        for name, share in zip(estimate.names, relative, strict=True)
        if share > LARGEST
    ]
    return tuple(sorted(found, key=lambda i: -i.relative))
