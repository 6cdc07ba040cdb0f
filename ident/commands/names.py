"""Files named without a flag: a study by its suffix, logs by theirs."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from difflib import get_close_matches

#: Suffixes of files that can only be logs.
_LOGS = (".csv", ".tsv", ".txt", ".gz", ".bz2", ".xz", ".mat", ".npz", ".parquet", ".pq", ".bag", ".mcap", ".db3")

#: Flags of one meaning that other commands have.
_SAME = {
    "--validate": ("--log",), "--held": ("--validate", "--log"), "--test": ("--validate", "--log"), "--train": ("--log",),
    "--data": ("--log",), "--file": ("--log",), "--input": ("--log",), "--output": ("--out",), "--output-dir": ("--out",),
    "--overwrite": ("--force",), "--model": ("--fit", "--urdf"), "--reference": ("--fit",), "--estimator": ("--method",),
}  # fmt: skip


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


def nearest_flags(parser: argparse.ArgumentParser, given: Sequence[str]) -> str:
    """What the flags of a command may be that were misspelt, or that another command has; "" where nothing is near."""
    known = [flag for action in parser._actions for flag in action.option_strings]
    hints = []
    for flag in (name.split("=", 1)[0] for name in given if name.startswith("--")):
        near = [other for other in _SAME.get(flag, ()) if other in known] or get_close_matches(flag, known, 2, 0.7)
        hints += [f"for {flag} this command has {' or '.join(near)}"] if near else []
    return f" ({'; '.join(hints)}; ident {parser.prog.split()[-1]} --help lists all)" if hints else ""


def _is_log(name: str) -> bool:
    return not name.startswith("-") and name.lower().endswith(_LOGS)
