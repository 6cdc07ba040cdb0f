"""How well a log tells when its commands were sent: those of another clock than its rows came at some time between two of them."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
#: Changes of a command at least, rows for which it usually stays, where it comes less often than the rows, and the share of changes that
#: come at another number of rows where it is not by their clock.
_MANY, _STAYS, _OTHERS = 20, 2.0, 0.05


def rows_of_a_command(commands: Array) -> float:
    """Rows for which commands (N, n) of another clock than the rows' usually stay, of the joint whose command changes most often; 1 where
    they come by the rows' clock (with each, or always after as many: a loop that logs and hands on a slower one's commands), or where too
    few of them change to say."""
    changes = [np.diff(np.flatnonzero(np.diff(column) != 0.0)) for column in commands.T]
    stays = min((rows for rows in changes if len(rows) >= _MANY), key=lambda rows: float(np.median(rows)), default=np.ones(1))
    usual = float(np.round(np.median(stays)))
    return usual if usual >= _STAYS and np.mean(stays % usual != 0.0) > _OTHERS else 1.0
