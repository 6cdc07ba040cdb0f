"""Files named without a flag: a study by its suffix, logs by theirs."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

#: Suffixes of files that can only be logs.
_LOGS = (".csv", ".tsv", ".txt", ".gz", ".bz2", ".xz", ".mat", ".npz", ".parquet", ".pq", ".bag", ".mcap", ".db3")


def take_names(args: argparse.Namespace, more: Sequence[str]) -> bool:
    """Sort what was given without a flag into the study and the logs, for commands that take both. False where something is neither."""
    if not getattr(args, "named_logs", False):
        return not more
    given = [*([args.study] if args.study else []), *more]
    studies = [name for name in given if not _is_log(name)]
    if any(name.startswith("-") or not name.lower().endswith(".toml") for name in studies[1:]) or len(studies) > 1:
        return False
    if studies and studies[0] in more and not studies[0].lower().endswith(".toml"):
        return False
    args.study = studies[0] if studies else None
    logs = [name for name in given if _is_log(name)]
    args.log = [*(args.log or []), *logs] or None
    return True


def _is_log(name: str) -> bool:
    return not name.startswith("-") and name.lower().endswith(_LOGS)
