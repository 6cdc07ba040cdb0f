"""One guard for structured text (TOML, JSON): size, depth, and what a parser would choke on, before it is parsed."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from ..errors import ConfigurationError

#: Largest file (bytes), deepest nesting, parts of a dotted key, and digits of a whole number that anyone needs.
_TOML_BYTES = 1 << 20
_JSON_BYTES = 1 << 30
_DEPTH = 60
_DIGITS = 300
_DOTTED = re.compile(r"^[\s\[]*(?:[\w\"'-]+\s*\.\s*){20,}", re.MULTILINE)
_LONG_NUMBER = re.compile(rf"\d{{{_DIGITS + 1},}}")


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The tables of a TOML file; `what` it is goes into the message of a ConfigurationError."""
    text = _text(path, what, _TOML_BYTES)
    _guard(text, f"{what} {path}")
    if _DOTTED.search(text):
        raise ConfigurationError(f"{what} {path}: a key of more than 20 parts joined by dots is not supported.")
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, ValueError, RecursionError) as error:
        raise ConfigurationError(f"{what} {path}: is not valid TOML: {error}.") from None


def read_json(path: Path, what: str) -> Any:
    """The content of a JSON file; `what` it is goes into the message of a ConfigurationError."""
    text = _text(path, what, _JSON_BYTES)
    _guard(text, f"{what} {path}")
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{what} {path}: is not JSON ({error}).") from None


def _text(path: Path, what: str, most: int) -> str:
    try:
        size = path.stat().st_size
        if size > most:
            raise ConfigurationError(f"{what} {path}: has {size} bytes; more than {most} are not supported.")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ConfigurationError(f"{what} {path}: no such file.") from None
    except UnicodeDecodeError:
        raise ConfigurationError(f"{what} {path}: is not text in UTF-8.") from None
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{what} {path}: cannot be read ({getattr(error, 'strerror', None) or error}).") from None


def _guard(text: str, where: str) -> None:
    """Refuse nesting and numbers that are nobody's. Brackets inside texts count too: nothing of ours has that many."""
    depth = deepest = 0
    for mark in re.findall(r"[\[{\]}]", text) if text.count("[") + text.count("{") > _DEPTH else ():
        depth += 1 if mark in "[{" else -1
        deepest = max(deepest, depth)
        if deepest > _DEPTH:
            raise ConfigurationError(f"{where}: is nested more than {_DEPTH} deep.")
    if _LONG_NUMBER.search(text):
        raise ConfigurationError(f"{where}: holds a number of more than {_DIGITS} digits.")
