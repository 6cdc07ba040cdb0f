"""The compiled reader of plain text: numbers equal Python's, whatever is not plain is refused as a whole, no text brings it down."""

from __future__ import annotations

import numpy as np
import pytest

text = pytest.importorskip("ident._native._text", reason="the compiled reader was not built")
TARGETS = np.array([[0, 0], [1, 1], [-1, 0], [1, 0]], np.int32)


def parse(source: bytes, room: int = 50) -> tuple[int, np.ndarray, np.ndarray]:
    """Rows read, and the two arrays that the fields go to."""
    t, x = np.full((room, 1), -7.0), np.full((room, 2), -7.0)
    return text.parse(source, ord(","), TARGETS, (t, x), (1, 2), room), t, x


def test_numbers_are_those_of_python() -> None:
    rng = np.random.default_rng(0)
    values = rng.standard_normal((40, 4)) * 10.0 ** rng.integers(-300, 300, (40, 4))
    lines = [",".join(repr(float(v)) for v in row) for row in values]
    rows, t, x = parse("\r\n".join(lines).encode())
    assert rows == 40
    assert np.array_equal(t[:40, 0], values[:, 0])
    assert np.array_equal(x[:40], values[:, [3, 1]])
    assert np.all(t[40:] == -7.0)


def test_missing_values_and_blanks() -> None:
    rows, t, x = parse(b" 1 , nan ,anything, NaN\n\n2,,,3e1\n")
    assert rows == 2
    assert t[:2, 0].tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(x[:2], [[np.nan, np.nan], [30.0, np.nan]])


@pytest.mark.parametrize(
    "source", [b"1,2,3\n", b"1,2,3,4,5\n", b'1,2,"a",4\n', b"1,2,3,4x\n", b"1,2,3,0x1p3\n", b"1,2,3,inf\n", b"1;2;3;4", b"1,2,3,4\n" * 51]
)
def test_what_is_not_plain_is_refused(source: bytes) -> None:
    assert parse(source)[0] == -1


def test_no_text_brings_it_down() -> None:
    rng = np.random.default_rng(1)
    alphabet = np.frombuffer(b'0123456789.,,,,eE+-nNaAi \t\r\n\n"x\x00\xff', np.uint8)
    for _ in range(3000):
        source = rng.choice(alphabet, rng.integers(0, 60)).tobytes()
        assert -1 <= parse(source, 8)[0] <= 8
        assert text.lines(source) == source.count(b"\n") + 1


def test_targets_outside_their_array_are_refused() -> None:
    with pytest.raises(ValueError, match="outside its array"):
        text.parse(b"1", ord(","), np.array([[0, 2]], np.int32), (np.zeros((1, 2)),), (2,), 1)
    with pytest.raises(ValueError, match="wrong size"):
        text.parse(b"1", ord(","), np.array([[0, 0]], np.int32), (np.zeros((1, 2)),), (2,), 3)
