"""What a field of a text table is, and which fault a text has: the same for whole files and pieces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ident

Array = np.ndarray
N = 60
T = np.arange(N) / 100
Q, TAU = np.sin(3 * T) + 0.25, 5.0 * np.cos(2 * T) + 7.0


def written(path: Path, change: dict[int, str], mark: str = ",", comma: str = ".") -> Path:
    """Rows of t, q1, tau1; of some, the torque as it is given."""
    rows = [
        mark.join([*(f"{x:.9f}".replace(".", comma) for x in (T[k], Q[k])), change.get(k, f"{TAU[k]:.9f}".replace(".", comma))])
        for k in range(N)
    ]
    path.write_text("\n".join([mark.join(["t", "q1", "tau1"]), *rows]) + "\n")
    return path


NOTHING = ["---", "- ", " -", "?", "n.a.", "#VALUE!", "#DIV/0!", "#NV", "Missing", "NULL ", "N/A", "nil", " "]


@pytest.mark.parametrize("text", NOTHING)
@pytest.mark.parametrize("german", [False, True])
def test_what_people_write_for_nothing_is_nothing(text: str, german: bool, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", {20: text, 41: text}, *((";", ",") if german else (",", ".")))
    log = ident.read_logs(path)[0]
    expected = TAU.copy()
    expected[[20, 41]] = np.nan
    np.testing.assert_allclose(log.tau["joint"][:, 0], expected, atol=1e-8)


@pytest.mark.parametrize(
    ("text", "mark", "comma", "remedy"),
    [
        ("1.000,50", ";", ",", "thousands separators"),
        ("\u22121.5", ",", ".", "Its minus sign"),
        ("1.000.000,5", ";", ",", "thousands separators"),
        ("1.000", ";", ",", "has a point, where other numbers have a decimal comma"),
        ('"1,000.50"', ",", ".", "thousands separators"),
        ('"1,000"', ",", ".", "thousands separators"),
        ("1'000.5", ",", ".", "thousands separators"),
        ("1\u202f000,5", ";", ",", "thousands separators"),
        ("1,5", ";", ".", "decimal comma: write the file with decimal points"),
        ("about 5", ",", ".", "write a missing value as an empty field"),
        ("2024-05-01 12:00:01", ",", ".", "a date with a time"),
    ],
)
def test_what_is_no_number_is_refused_with_what_to_do(text: str, mark: str, comma: str, remedy: str, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", {30: text}, mark, comma)
    with pytest.raises(ident.DataError, match=rf"column 'tau1', line 32 \(data row 31\): .* is not a number\. .*{remedy}"):
        ident.read_logs(path)


def test_the_first_fault_is_told_though_a_reader_stumbles_over_another(tmp_path: Path) -> None:
    """Pandas does not take `- ` for nothing, which is no fault; the row with a line's end in quotes behind it is one."""
    path = written(tmp_path / "a.csv", {10: "- ", 40: '"1'})
    text = path.read_text().splitlines()
    text[44] = text[44].replace(",", '",', 1)
    path.write_text("\n".join(text) + "\n")
    with pytest.raises(ident.DataError, match=r"line 42 \(data row 41\): .* is not a number|line 42 \(data row 41\) has \d+ fields"):
        ident.read_logs(path)


def test_a_text_that_only_this_reads_keeps_every_bit(tmp_path: Path) -> None:
    rows = [f"{t!r},{q!r},{tau!r}" for t, q, tau in zip(T.tolist(), Q.tolist(), TAU.tolist(), strict=True)]
    plain, odd = tmp_path / "plain.csv", tmp_path / "odd.csv"
    plain.write_text("\n".join(["t,q1,tau1", *rows]) + "\n")
    rows[7] += " "
    rows.insert(30, "")
    odd.write_text("\n".join(["t,q1,tau1,more", *(f"{row},- " if row else row for row in rows)]) + "\n")
    one, two = (ident.read_logs(path)[0] for path in (plain, odd))
    for name in ("t", "q"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    np.testing.assert_array_equal(one.tau["joint"], two.tau["joint"])
