"""How well a log tells when its commands were sent: those that stay for several rows came at some time between two of them."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
#: Changes of a command at least, and rows for which it usually stays, where it comes less often than the rows.
_MANY, _STAYS = 20, 2.0


def rows_of_a_command(commands: Array) -> float:
    """Rows for which commands (N, n) usually stay, of the joint whose command changes most often; 1 where they come with the rows, or
    where too few of them change to say."""
    changes = [np.flatnonzero(np.diff(column) != 0.0) for column in commands.T]
    often = [float(np.median(np.diff(rows))) for rows in changes if len(rows) >= _MANY]
    least = min(often, default=1.0)
    return least if least >= _STAYS else 1.0
