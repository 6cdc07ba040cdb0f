"""Errors a user can act on. Each says what is wrong, where, and what to do; each knows its exit code."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

#: A message of more characters than this quotes something that is no name; words, and what stands in quotes, of more than `_SHOWN` are cut.
_LONGEST, _SHOWN = 600, 120
_LONG_WORD = re.compile(rf"[^ \n]{{{_SHOWN},}}")  # spaces of other scripts part no words of ours
_QUOTED = re.compile(r""""[^"]*"|(?<![^\s(\[{])'[^'\n]*'""")


class IdentError(Exception):
    """Base of every error that `ident` raises on purpose.

    Examples
    --------
    >>> import ident
    >>> issubclass(ident.DataError, ident.IdentError)
    True
    """

    exit_code = 2

    def __init__(self, message: str = "") -> None:
        message = message.replace("\x00", "\\x00")  # a terminal shows nothing where one stands
        for long in (_QUOTED, _LONG_WORD) if len(message) > _LONGEST else ():
            message = long.sub(lambda found: found[0] if len(found[0]) < _SHOWN else f"{found[0][:_SHOWN]}…", message)
        super().__init__(message)


class ConfigurationError(IdentError, ValueError):
    """The request is wrong: a bad argument, study file, robot description or unknown name (exit code 2).

    Examples
    --------
    >>> import ident
    >>> try:
    ...     ident.load_robot("puma")
    ... except ident.ConfigurationError as error:
    ...     error.exit_code
    2
    """

    exit_code = 2


class DataError(IdentError, ValueError):
    """The data cannot be used for what was asked (exit code 3).

    Examples
    --------
    >>> import ident
    >>> try:
    ...     ident.read_logs("nosuch.csv")
    ... except ident.DataError as error:
    ...     error.exit_code
    3
    """

    exit_code = 3


class UnsupportedError(ConfigurationError):
    """A method was asked for what it cannot do; the text names one that can.

    Examples
    --------
    >>> import ident
    >>> try:
    ...     ident.make_estimator("ls").start(ident.load_robot("scara").rigid_body())
    ... except ident.UnsupportedError as error:
    ...     error.exit_code
    2
    """


def unknown_name(kind: str, name: str, known: Iterable[str]) -> ConfigurationError:
    """An error for a name that is not known, with the nearest known names.

    `kind` is what the name should be, in the singular ("effect", "method", "joint")."""
    names = sorted(known)
    # Of a name of two or three letters, one may differ; half of a longer one is no likeness.
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5 if len(name) <= 3 else 0.6)
    hint = f"; did you mean {' or '.join(repr(n) for n in near)}?" if near else "."
    return ConfigurationError(f"unknown {kind} {name!r}{hint} Known: {', '.join(names)}")
