"""MATLAB files that say of themselves what is false are refused before another library is given them, which ends the process."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse
from scipy.io import savemat

import ident
from ident.errors import DataError
from ident.logs.readers.mat_structure import check_structure

T = np.arange(200) * 0.01
LOG = {"t": T, "q": np.stack([np.sin(T), np.cos(T)], axis=1), "tau": np.stack([T, 1.0 - T], axis=1)}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    "more",
    [
        {},
        {"z": np.array([1.0 + 2.0j, 3.0])},
        {"s": {"a": 1.0, "inside": {"b": np.arange(3), "text": "words"}}},
        {"c": np.array([1.0, "two", np.zeros((2, 3))], dtype=object)},
        {"e": np.zeros((0, 3)), "cube": np.zeros((2, 3, 4)), "flag": np.array([True, False])},
        {"i": np.arange(5, dtype=np.int8), "u": np.arange(5, dtype=np.uint64), "f": np.arange(5, dtype=np.float32)},
        {"sparse": scipy.sparse.csc_array(np.eye(4)), "none": np.zeros(0, dtype=object)},
        {"structs": np.array([(1.0, "a"), (2.0, "b")], dtype=[("x", object), ("name", object)])},
    ],
)
def test_what_is_sound_is_let_through(tmp_path: Path, more: dict[str, Any], packed: bool) -> None:
    path = tmp_path / "a.mat"
    savemat(path, LOG | more, do_compression=packed)
    check_structure(path)


def test_a_flag_that_asks_for_a_part_that_is_not_there(tmp_path: Path) -> None:
    """scipy reads on beyond the array, which ended the process by signal 11."""
    path = tmp_path / "a.mat"
    savemat(path, LOG)
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack("<II", 6, 8)) + 8
    data[at + 1] |= 0x08  # complex
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"a\.mat"):
        ident.read_logs(path)


def test_no_byte_that_is_changed_ends_the_process_or_the_log(tmp_path: Path) -> None:
    """The head of the first array, and what follows to its numbers: each damage is refused, or the log is read with all its rows."""
    path = tmp_path / "a.mat"
    savemat(path, LOG)
    whole = path.read_bytes()
    rows = []
    for at in range(128, 184):
        data = bytearray(whole)
        data[at] ^= 0x5A
        path.write_bytes(data)
        try:
            rows.append(len(ident.read_logs(path)[0].t))
        except DataError:
            rows.append(0)
    assert set(rows) == {0, T.size}
