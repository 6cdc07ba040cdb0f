"""Words by which names say that something was asked for, or measured: of files, of topics and of columns."""

from __future__ import annotations

DESIRED = frozenset({"desired", "des", "target", "reference", "ref", "command", "commanded", "commands", "cmd", "setpoint", "soll", "goal"})
MEASURED = frozenset({"measured", "meas", "actual", "feedback", "state", "ist"})
