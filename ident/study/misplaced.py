"""Keys of a study file that stand in another table than theirs."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from ..errors import ConfigurationError
from ..robots.tables import DriveTable, RobotTable
from .tables import LOGS

_KEYS = {"robot": set(RobotTable.SCHEMA), "drive": set(DriveTable.SCHEMA), "logs": set(LOGS)}


def refuse_misplaced(data: Mapping[str, Any], tables: Mapping[str, Any], where: str) -> None:
    """Raise ConfigurationError for the first key that another of the study's `tables` has: one before all tables, of a table that is
    none, or of one that has no such key."""
    for table, value in data.items():
        own = _KEYS.get(table)
        if table in tables and own is None:
            continue  # methods' options and columns may have any name
        if table not in tables and difflib.get_close_matches(table, tables, n=1):
            continue  # a table's name that is misspelt
        here = {table: value} if table not in tables and not isinstance(value, Mapping) else value
        for key in here if isinstance(here, Mapping) else ():
            homes = [home for home, keys in _KEYS.items() if key in keys]
            if homes and key not in (own or ()):
                stands = f"under [{table}]" if here is value else "before all tables"
                raise ConfigurationError(f"{where}: {key} stands {stands}; it belongs to [{homes[0]}].")
