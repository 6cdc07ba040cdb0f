"""Tables of a study file: `[logs]`, `[signals]`, `[estimator]`, and entries of `[columns]`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._utils.toml import anything, check_table, number, text, texts
from ..errors import ConfigurationError
from .paths import from_folder

#: Keys of `[logs]`.
LOGS = {"fit": texts, "validate": texts, "missing": text, "rate_hz": number, "recorders": texts}


@dataclass(frozen=True)
class LogsTable:
    """`[logs]`: files or patterns, relative ones joined to the folder of the study. `missing`: see `read_logs`; None: refuse.
    `rate_hz`: samples per second of logs without a time; `recorders`: files of recorders that are not known (docs/logs.md)."""

    fit: tuple[str, ...] = ()
    validate: tuple[str, ...] = ()
    missing: str | None = None
    rate_hz: float | None = None
    recorders: tuple[str, ...] = ()


@dataclass(frozen=True)
class Strategy:
    """A strategy by its name, with its options: `[signals]` or `[estimator]`. Name None: the usual one."""

    method: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def without(self, option: str) -> Strategy:
        """The same strategy without one of its options."""
        return Strategy(self.method, {k: v for k, v in self.options.items() if k != option})


def logs_table(data: Any, folder: Path, where: str) -> LogsTable:
    """The `[logs]` table of a study in `folder`."""
    logs = check_table(data, LOGS, "logs", where)
    missing, rate_hz = logs.pop("missing", None), logs.pop("rate_hz", None)
    files = {key: tuple(from_folder(folder, entry) for entry in entries) for key, entries in logs.items()}
    return LogsTable(**files, missing=missing, rate_hz=rate_hz)


def column_entry(value: Any) -> Any:
    """The name of a column, or a table of `column` and any of `unit`, `scale`, `offset`."""
    if isinstance(value, Mapping):
        return check_table(value, {"column": text, "unit": text, "scale": number, "offset": number}, "columns", "study")
    return text(value)


def strategy(data: Any, table: str, where: str) -> Strategy:
    """A table of a strategy: its method, and everything else as its options."""
    options = check_table(data, dict.fromkeys(data, anything) if isinstance(data, Mapping) else {}, table, where)
    method = options.pop("method", None)
    if method is not None and not isinstance(method, str):
        raise ConfigurationError(f"{where}: [{table}] method must be a text, not {method!r}.")
    return Strategy(method, {k: tuple(v) if isinstance(v, list) else v for k, v in options.items()})
