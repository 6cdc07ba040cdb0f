"""The torque of a run whose controller knows all beforehand: what compiled code can follow without asking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..robots.transmission import Side

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Script:
    """Torque at K control instants of B runs: `forward` + kp (q − measured position) + kd (dq − measured speed), within ±limit.

    Arrays (K, B, n) on `side`; `kp`, `kd`, `limit` (n,). Without gains it is `forward` alone, whatever the state."""

    side: Side
    forward: Array
    q: Array | None = None
    dq: Array | None = None
    kp: Array | None = None
    kd: Array | None = None
    limit: Array | None = None
