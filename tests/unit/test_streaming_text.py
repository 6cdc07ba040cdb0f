"""Text as users' loggers leave it: streamed in small pieces it gives what the whole file gives, or the same error, by every reader."""

from __future__ import annotations

import bz2
import lzma
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ident.errors import DataError
from ident.logs.columns import resolve_columns
from ident.logs.log import Log
from ident.logs.names import JointNames
from ident.logs.readers.tables import read_header
from ident.logs.reading import read_logs
from ident.robots.robot import Robot
from ident.streaming.ingest import Reading, store_logs
from ident.streaming.text import TextParser

Array = np.ndarray
JOINTS = 4
NAMES = ["t", *(f"q{j + 1}" for j in range(JOINTS)), *(f"tau{j + 1}" for j in range(JOINTS))]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    from command_line import ARM

    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM)
    return Robot.from_urdf(path)


@pytest.fixture(params=["compiled", "arrow", "pandas"], autouse=True)
def reader(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Each of the readers of pieces; small pieces, so that whatever is odd lies across a border sooner or later."""
    monkeypatch.setattr("ident.streaming.tables.TEXT_PIECE", 1500)
    monkeypatch.setattr("ident.streaming.ingest._BLOCK", 50)
    if request.param == "compiled":
        pytest.importorskip("ident._native._text", reason="the compiled reader was not built")
    monkeypatch.setenv("IDENT_KERNEL", "native" if request.param == "compiled" else "numpy")
    if request.param == "arrow":
        pytest.importorskip("pyarrow")
    else:
        monkeypatch.setattr("ident.streaming.text.find_spec", lambda name: None)
    return str(request.param)


def numbers(rows: int = 120) -> list[list[str]]:
    rng = np.random.default_rng(3)
    values = rng.standard_normal((rows, len(NAMES))) * 10.0 ** rng.integers(-9, 9, (rows, len(NAMES)))
    values[:, 0] = np.arange(rows) / 100
    return [[repr(float(x)) for x in row] for row in values]


def written(path: Path, rows: list[list[str]], *, header: list[str] = NAMES, sep: str = ",", end: str = "\n", last: str = "\n") -> Path:
    text = end.join(sep.join(row) for row in [header, *rows]) + last
    path.write_bytes(text.encode())
    return path


def outcome(work: Callable[[], Any]) -> list[Log] | str:
    """The logs, or what the error says."""
    try:
        return list(work())
    except DataError as error:
        return str(error)


def alike(path: Path, robot: Robot, folder: Path, columns: dict[str, Any] | None = None, missing: str = "refuse") -> list[Log] | str:
    """Both ways' outcome, which must be the same."""
    whole = outcome(lambda: read_logs(path, robot, columns, missing=missing, extra=False))
    stored = outcome(lambda: [log.read(0, len(log)) for log in store_logs(path, folder, Reading(robot, columns, missing, jobs=2))])
    if isinstance(whole, str) or isinstance(stored, str):
        assert stored == whole
        return stored
    assert [log.name for log in stored] == [log.name for log in whole]
    for a, b in zip(whole, stored, strict=True):
        assert a.notes == b.notes
        assert a.sha256 == b.sha256
        torque = [(np.where(np.isfinite(a.tau[k]), a.tau[k], np.nan), b.tau[k]) for k in a.tau]
        for x, y in ((a.t, b.t), (a.q, b.q), (a.dq, b.dq), *torque):
            assert (x is None) == (y is None)
            if x is not None and y is not None:
                assert np.array_equal(x, y, equal_nan=True)
        assert set(a.tau) == set(b.tau)
    return stored


PLAIN: dict[str, dict[str, str]] = {
    "line feeds": {},
    "CRLF": {"end": "\r\n", "last": "\r\n"},
    "no last line feed": {"last": ""},
    "CRLF, no last one": {"end": "\r\n", "last": ""},
    "semicolons": {"sep": ";"},
    "tabs": {"sep": "\t"},
    "blanks behind commas": {"sep": ", "},
    "blank lines at the end": {"last": "\n\n\n"},
}


@pytest.mark.parametrize("kind", PLAIN)
def test_plain_tables(kind: str, robot: Robot, tmp_path: Path, reader: str) -> None:
    path = written(tmp_path / "log.csv", numbers(), **PLAIN[kind])  # type: ignore[arg-type]
    found = alike(path, robot, tmp_path / "scratch")
    assert not isinstance(found, str)
    assert len(found[0]) == 120
    if reader == "compiled":
        # Nothing here is odd enough to need another reader.
        header = read_header(path)
        plan = resolve_columns(header.names, JointNames(robot.joint_names, tuple(j.prismatic for j in robot.joints)))
        body = path.read_bytes().split(b"\n", 1)[1]
        assert TextParser(path, header, plan)._plain(memoryview(body)) is not None


def field(row: int, column: int, text: str) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        rows[row][column] = text

    return change


def line(row: int, fields: list[str]) -> Callable[[list[list[str]]], None]:
    return lambda rows: rows.insert(row, fields)


ODD: dict[str, Callable[[list[list[str]]], Any]] = {
    "empty torque": field(70, 6, ""),
    "blank torque": field(70, 6, "  "),
    "nan torque": field(70, 6, "nan"),
    "NaN in the last column": field(70, 8, "NaN"),
    "null torque": field(70, 6, "null"),
    "NA torque": field(70, 6, "NA"),
    "infinite torque": field(70, 6, "inf"),
    "plus sign": field(70, 6, "+1.5"),
    "quoted number": field(70, 6, '"1.25"'),
    "bare point": field(70, 6, "5."),
    "leading point": field(70, 6, "-.5"),
    "capital exponent": field(70, 6, "1E-3"),
    "too large": field(70, 6, "1e999"),
    "too small": field(70, 6, "1e-999"),
    "subnormal": field(70, 6, "4.9e-324"),
    "forty digits": field(70, 6, "0.1234567890123456789012345678901234567890"),
    "half way between two": field(70, 6, "9007199254740993"),
    "hexadecimal": field(70, 6, "0x10"),
    "underscore": field(70, 6, "1_000"),
    "decimal comma": field(70, 6, "1,5"),
    "text": field(70, 6, "oops"),
    "number and text": field(70, 6, "1.5 N"),
    "lone sign": field(70, 6, "-"),
    "empty position": field(70, 3, ""),
    "empty time": field(70, 0, ""),
    "block of missing positions": lambda rows: [row.__setitem__(2, "") for row in rows[40:70]],
    "blank line": line(60, [""]),
    "line of commas": line(60, [""] * len(NAMES)),
    "too few fields": lambda rows: rows[80].__delitem__(slice(5, None)),
    "too many fields": lambda rows: rows[80].append("1.0"),
    "repeated header": line(60, list(NAMES)),
    "comment between": line(60, ["# a comment"]),
    "text behind a comment": lambda rows: (field(70, 6, "oops")(rows), rows.insert(20, ["# a comment"])),
    "cut off in the last line": lambda rows: (rows[-1].__delitem__(slice(4, None)), field(-1, 3, "0.12")(rows)),
    "line ends within quotes": field(70, 6, '"1.0\n"'),
    "not UTF-8 but in a number": field(70, 6, "µ"),
    "time starts again": lambda rows: [row.__setitem__(0, repr(i % 60 / 100)) for i, row in enumerate(rows)],
    "time runs backwards": lambda rows: rows.insert(90, rows.pop(30)),
    "repeated stamp": lambda rows: rows[50].__setitem__(0, rows[49][0]),
    "stamps too coarse": lambda rows: [row.__setitem__(0, f"{i // 2 * 0.02:.2f}") for i, row in enumerate(rows)],
    "every row twice": lambda rows: rows.__setitem__(slice(None), [list(row) for row in rows for _ in range(2)]),
    "neighbours that changed places": lambda rows: rows.insert(25, rows.pop(26)),
    "gap": lambda rows: rows.__delitem__(slice(40, 70)),
}


@pytest.mark.parametrize("kind", ODD)
def test_odd_tables(kind: str, robot: Robot, tmp_path: Path) -> None:
    rows = numbers()
    ODD[kind](rows)
    for missing in ("refuse", "gap") if "position" in kind else ("refuse",):
        alike(written(tmp_path / "log.csv", rows), robot, tmp_path / missing, missing=missing)


@pytest.mark.parametrize(
    ("kind", "what"),
    [
        ("stamps too coarse", r"rows repeat the time stamp before \(data rows 2, 4, 6, 8 …\), but not its positions"),
        ("neighbours that changed places", r"time runs backwards at data row 27"),
    ],
)
def test_stamps_that_tell_no_time_are_refused(kind: str, what: str, robot: Robot, tmp_path: Path) -> None:
    rows = numbers()
    ODD[kind](rows)
    found = alike(written(tmp_path / "log.csv", rows), robot, tmp_path / "scratch")
    assert isinstance(found, str)
    assert re.search(what, found)


def test_rows_written_twice_are_the_same_sample(robot: Robot, tmp_path: Path) -> None:
    once, twice = numbers(), numbers()
    ODD["every row twice"](twice)
    read = [alike(written(tmp_path / f"{i}.csv", rows), robot, tmp_path / f"{i}") for i, rows in enumerate((once, twice))]
    assert not isinstance(read[0], str)
    assert not isinstance(read[1], str)


@pytest.mark.parametrize(
    ("kind", "line", "what"), [("text", 72, "'tau2'"), ("too many fields", 82, "10 fields"), ("text behind a comment", 73, "'tau2'")]
)
def test_errors_name_line_and_column(kind: str, line: int, what: str, robot: Robot, tmp_path: Path) -> None:
    rows = numbers()
    ODD[kind](rows)
    found = alike(written(tmp_path / "log.csv", rows), robot, tmp_path / "scratch")
    assert isinstance(found, str)
    assert f"line {line} " in found
    assert what in found


def test_lines_that_are_no_rows_are_left_out_and_said(robot: Robot, tmp_path: Path) -> None:
    rows = numbers()
    plain = alike(written(tmp_path / "plain.csv", rows[:-1]), robot, tmp_path / "plain")
    rows[-1][-1] = "1.5e"
    mixed = [*rows[:20], ["# the operator, with a comma", " came"], *rows[20:70], NAMES, *rows[70:90], ["// again"], *rows[90:]]
    found = alike(written(tmp_path / "mixed.csv", mixed, last=""), robot, tmp_path / "mixed")
    assert not isinstance(found, str)
    assert not isinstance(plain, str)
    assert [note.split(": ", 1)[1] for note in found[0].notes[:3]] == [
        "comments between the rows (2) are left out.",
        "the header is repeated between the rows (1×); the repetitions are left out.",
        "the last line is an incomplete row, and is left out.",
    ]
    for name in ("t", "q", "dq"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(plain[0], name))
    # With its last line ended, nobody cut it: it is wrong.
    assert isinstance(alike(written(tmp_path / "mixed.csv", mixed), robot, tmp_path / "wrong"), str)


@pytest.mark.parametrize("holes", [False, True])
def test_rows_that_repeat_the_row_before_are_left_out_in_streaming_too(
    holes: bool, robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ident.streaming.repeats.PASS", 37)
    rng = np.random.default_rng(5)
    t = np.arange(400) / 100
    phase = np.outer(3 * t, 1 + np.arange(JOINTS)) + np.arange(JOINTS)
    values = np.column_stack([t, np.sin(phase), np.cos(phase) + 0.01 * rng.standard_normal(phase.shape)])[:, : len(NAMES)]
    values = np.column_stack([values, np.zeros((400, len(NAMES) - values.shape[1]))])
    again = np.sort(rng.choice(np.arange(5, 395), 40, replace=False))
    for k in again:
        values[k, 1:] = values[k - 1, 1:]
    rows = [[repr(float(x)) for x in row] for row in values]
    if holes:
        for k in (*again[:3] - 1, 200, 201, 300):
            rows[k][2] = ""
    found = alike(written(tmp_path / "log.csv", rows), robot, tmp_path / "scratch", missing="gap")
    assert not isinstance(found, str)
    assert any("rows repeat the row before in every column but the time" in note for note in found[0].notes)
    assert 355 <= len(found[0]) + (6 if holes else 0) <= 375


def test_desired_motion_is_streamed_too(robot: Robot, tmp_path: Path) -> None:
    own = [*(f"q_ref{j + 1}" for j in range(JOINTS)), *(f"dq_ref{j + 1}" for j in range(JOINTS))]
    other = [*(f"target_pos_{j}" for j in range(1, JOINTS + 1)), *(f"target_vel_{j}" for j in range(1, JOINTS + 1))]
    rows = [[*row, *(repr(0.01 * k + j) for j in range(2 * JOINTS))] for k, row in enumerate(numbers())]
    for name, more in (("own", own), ("other", other)):
        header = [*NAMES, *more] if name == "own" else ["time", *(n.replace("q", "actual_pos_") for n in NAMES[1:]), *more]
        path = written(tmp_path / f"{name}.csv", rows, header=header)
        found = alike(path, robot, tmp_path / name)
        assert not isinstance(found, str)
        whole = read_logs(path, robot)[0]
        assert set(own) <= set(found[0].extra)
        for key in own:
            np.testing.assert_allclose(found[0].extra[key], whole.extra[key], rtol=1e-15)


def test_headers(robot: Robot, tmp_path: Path) -> None:
    long = [*NAMES, *(f"a_rather_long_name_of_a_column_that_nobody_needs_{i}" for i in range(300))]
    wide = [[*row, *("word" for _ in range(300))] for row in numbers(40)]
    quoted = [f'"{name}"' for name in NAMES]
    for i, (header, rows) in enumerate(((long, wide), (quoted, numbers()))):
        found = alike(written(tmp_path / f"{i}.csv", rows, header=header), robot, tmp_path / f"{i}")
        assert not isinstance(found, str)
    for i, lead in enumerate((b"\xef\xbb\xbf", b"# comment\n# another, with commas\n", b"\n\n", b"# CRLF\r\n")):
        path = written(tmp_path / "led.csv", numbers())
        path.write_bytes(lead + path.read_bytes())
        found = alike(path, robot, tmp_path / f"led-{i}")
        assert not isinstance(found, str)


def test_units_mapping_and_joints_without_torque(robot: Robot, tmp_path: Path) -> None:
    header = ["time_ms", *(f"q{j + 1}" + ("_deg" if j else "_mm") for j in range(JOINTS)), "tau1", "load", "note", "angle"]
    rows = [[*row[:7], "text", row[8]] for row in numbers()]
    for row in rows:
        row[0] = repr(1000 * float(row[0]))
    path = written(tmp_path / "log.csv", rows, header=header)
    assert not isinstance(alike(path, robot, tmp_path / "a"), str)
    columns = {"q2": {"column": "angle", "scale": -2.0, "offset": 0.25}, "tau2": {"column": "load", "scale": 0.5}}
    assert not isinstance(alike(path, robot, tmp_path / "b", columns), str)
    # One column that is used twice.
    twice = {"tau2": "load", "tau3": "load"}
    assert not isinstance(alike(path, robot, tmp_path / "c", twice), str)


@pytest.mark.parametrize(("suffix", "squeeze"), [(".bz2", bz2.compress), (".xz", lzma.compress)])
def test_compressed(suffix: str, squeeze: Callable[[bytes], bytes], robot: Robot, tmp_path: Path) -> None:
    plain = written(tmp_path / "log.csv", numbers())
    path = tmp_path / f"log.csv{suffix}"
    path.write_bytes(squeeze(plain.read_bytes()))
    assert not isinstance(alike(path, robot, tmp_path / "a"), str)
    path.write_bytes(squeeze(plain.read_bytes())[:-40])
    found = alike(path, robot, tmp_path / "b")
    assert isinstance(found, str)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_is_struck_out_or_typed_in(data: st.DataObject, robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A few characters of a table changed anywhere: the same arrays or the same error."""
    folder = tmp_path_factory.mktemp("typed")
    text = bytearray(written(folder / "log.csv", numbers(30)).read_bytes())
    start = text.index(b"\n") + 1
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(start, len(text) - 1))
        gone = data.draw(st.integers(0, 3))
        text[at : at + gone] = data.draw(st.text("0123456789.,;-+eE \t\nnaN\"'#x", max_size=3)).encode()
    (folder / "log.csv").write_bytes(bytes(text))
    alike(folder / "log.csv", robot, folder / "scratch")


def test_quotes_that_are_never_closed_hide_no_rows(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader: str) -> None:
    """In a column that is not even read: a lenient reader takes everything behind the quotes for one field, and half the log is gone."""
    path = tmp_path / "log.csv"
    rows = [[*row, "note"] for row in numbers()]
    rows[70][-1] = '"note'
    path.write_text("\n".join(",".join(row) for row in [[*NAMES, "comment"], *rows]) + "\n")
    if reader == "pandas":
        monkeypatch.setattr("ident.logs.readers.text.find_spec", lambda name: None)
    found = alike(path, robot, tmp_path / "scratch")
    assert isinstance(found, str), "rows are missing, and nothing says so"
    assert "line 72 (data row 71) opens a quote that is never closed" in found
