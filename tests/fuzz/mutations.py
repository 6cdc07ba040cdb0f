"""Changes to files: of bytes, of lines and fields, of the values of a tree. Each draws from a generator that is handed in."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np

Rng = np.random.Generator
#: Texts where a number should be: signs, limits of doubles, other scripts, other programs' words for nothing.
NUMBERS = (
    "nan", "NaN", "inf", "-inf", "1e308", "-1e308", "1.8e308", "1e-320", "0", "-0", "-1", "1e5", "1e300", "1e30", "", " ", "x", "1,5",
    "1_000", "0x10", "１２", "1e", "--1", "+", ".", "1.2.3", "9" * 40, "9" * 400, "1e400", "None", "null", "true", "\x00", "é", "1 2",
    "1;2", '"', "''", "2024-01-01T00:00:00", "1e9", "-1e9", "12345678901234567890",
)  # fmt: skip
#: Values where another kind of value should be.
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 1e308, -1e308, float("nan"), float("inf"), 10**30, 10**310, "", "x", "\x00", "é" * 50, "n" * 500, [],
    [None], [[]], [1, 2, 3], ["a"], {}, {"a": 1}, {"": None}, [float("nan")] * 3, 1e-320, [[1.0, 2.0], [3.0]], [0] * 40,
)  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


def of(rng: Rng, choices: Any) -> Any:
    return choices[int(rng.integers(len(choices)))]


def flip(rng: Rng, data: bytes) -> bytes:
    """Some bytes become others."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        if out:
            out[int(rng.integers(len(out)))] = int(rng.integers(256))
    return bytes(out)


def cut(rng: Rng, data: bytes) -> bytes:
    """The end is missing."""
    return data[: int(rng.integers(len(data) + 1))]


def drop(rng: Rng, data: bytes) -> bytes:
    """A part is missing."""
    a, b = sorted(int(x) for x in rng.integers(len(data) + 1, size=2))
    b = min(b, a + int(rng.integers(1, 200)))
    return data[:a] + data[b:]


def double(rng: Rng, data: bytes) -> bytes:
    """A part stands twice."""
    a, b = sorted(int(x) for x in rng.integers(len(data) + 1, size=2))
    return data[:b] + data[a:b] + data[b:]


def insert(rng: Rng, data: bytes) -> bytes:
    """Something foreign stands in it."""
    at = int(rng.integers(len(data) + 1))
    what = of(
        rng,
        (
            b"\x00",
            b"\xff\xfe",
            b"\xef\xbb\xbf",
            b"\r",
            b"\n",
            b"\n\n",
            b'"',
            b"<",
            b"&lt;",
            b"&x;",
            b"#",
            b",",
            b";",
            b"\t",
            b"\xe9",
            b"]]>",
            b"9" * 500,
        ),
    )
    return data[:at] + what + data[at:]


def renumber(rng: Rng, data: bytes) -> bytes:
    """A few numbers become hostile ones."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return flip(rng, data)
    chosen = sorted({int(i) for i in rng.integers(len(found), size=int(rng.integers(1, 4)))}, reverse=True)
    for i in chosen:
        a, b = found[i].span()
        data = data[:a] + of(rng, NUMBERS).encode() + data[b:]
    return data


def respeak(rng: Rng, data: bytes) -> bytes:
    """The whole in another encoding, with other line ends, or with a mark of byte order."""
    text = data.decode("utf-8", "replace")
    way = int(rng.integers(6))
    if way == 0:
        return text.encode("utf-16")
    if way == 1:
        return text.replace("e", "é").encode("latin-1", "replace")
    if way == 2:
        return b"\xef\xbb\xbf" + data
    if way == 3:
        return data.replace(b"\n", b"\r\n")
    if way == 4:
        return data.replace(b"\n", b"\r")
    return text.encode("utf-32")


def lines(rng: Rng, data: bytes) -> bytes:
    """Lines are missing, stand twice, or change places."""
    rows = data.splitlines(keepends=True)
    if len(rows) < 2:
        return flip(rng, data)
    i, j = (int(x) for x in rng.integers(len(rows), size=2))
    way = int(rng.integers(4))
    if way == 0:
        del rows[i]
    elif way == 1:
        rows.insert(j, rows[i])
    elif way == 2:
        rows[i], rows[j] = rows[j], rows[i]
    else:
        rows = rows[: 1 + i]
    return b"".join(rows)


def first_line(rng: Rng, data: bytes) -> bytes:
    """The head is changed: a field renamed, left out, doubled."""
    head, end, rest = data.partition(b"\n")
    fields = head.split(b",")
    i = int(rng.integers(len(fields)))
    way = int(rng.integers(5))
    if way == 0:
        fields[i] = of(
            rng, (b"", b"t", b"q1", b"tau1", b"q99", b"q1_deg", b"q[0]", b"position", b"name", b"q1 [rad]", b"x" * 300, b'"', b"\xff")
        )
    elif way == 1:
        del fields[i]
    elif way == 2:
        fields.insert(i, of(rng, fields))
    elif way == 3:
        fields = fields[::-1]
    else:
        fields = fields + [b"extra"] * int(rng.integers(1, 40))
    return b",".join(fields) + end + rest


BYTES: tuple[Callable[[Rng, bytes], bytes], ...] = (flip, cut, drop, double, insert)
TEXT: tuple[Callable[[Rng, bytes], bytes], ...] = (*BYTES, renumber, renumber, renumber, respeak, lines)
TABLE: tuple[Callable[[Rng, bytes], bytes], ...] = (*TEXT, first_line, first_line)


def mutated(rng: Rng, data: bytes, ways: tuple[Callable[[Rng, bytes], bytes], ...]) -> bytes:
    """One to three changes, one after the other."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        data = of(rng, ways)(rng, data)
    return data


# --- trees --------------------------------------------------------------------------------------------------------------


def tree(rng: Rng, content: Any) -> Any:
    """A copy of plain data (tables, lists, values) in which one place is changed: another value, missing, doubled, renamed."""
    content = json.loads(json.dumps(content))
    for _ in range(int(rng.choice([1, 1, 2]))):
        _change(rng, content)
    return content


def _change(rng: Rng, content: Any) -> None:
    """Walk down by chance, and change where the walk ends."""
    here, depth = content, 0
    while True:
        keys = list(here) if isinstance(here, dict) else list(range(len(here)))
        if not keys:
            return
        key = of(rng, keys)
        below = here[key]
        if isinstance(below, dict | list) and below and depth < 12 and rng.random() < 0.8:
            here, depth = below, depth + 1
            continue
        break
    way = int(rng.integers(6))
    if way <= 2:
        here[key] = deepcopy(of(rng, VALUES))
    elif way == 3:
        del here[key]
    elif way == 4 and isinstance(here, list):
        here.append(deepcopy(here[key]))
    elif way == 4:
        here[str(of(rng, ("x", "", "name", "\x00")))] = here.pop(key)
    elif isinstance(below := here[key], bool | str):
        here[key] = str(of(rng, (below, "", "x"))) + str(of(rng, ("", "x", " ")))
    elif isinstance(below, int | float):
        far = below * 1e200 if abs(below) < 1e100 else below  # an integer may be too large for any float
        near = below + 0.5 if abs(below) < 1e100 else below
        here[key] = of(rng, (below * -1, far, near, str(below)))
    else:
        here[key] = [below] if rng.random() < 0.5 else None
