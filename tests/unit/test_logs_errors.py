"""Logs that cannot be used: the message says what, where and what to do; the exit code is the data's (3) or the request's (2)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident import ZeroPhase, audit, demo_logs
from ident.errors import ConfigurationError, DataError, IdentError
from ident.logs.reading import read_logs
from ident.robots.robot import Robot


def chain(n: int) -> Robot:
    links = "".join(f'<link name="l{k}"/>' for k in range(n + 1))
    joints = "".join(
        f'<joint name="j{k + 1}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="0 0 1"/></joint>' for k in range(n)
    )
    return Robot.from_urdf(f'<robot name="chain">{links}{joints}</robot>')


@pytest.fixture(scope="module")
def robot() -> Robot:
    return chain(6)


def csv(path: Path, header: str, rows: int = 50, replace: dict[tuple[int, int], str] | None = None) -> Path:
    width = header.count(",") + 1
    lines = [[f"{0.01 * k:.6f}", *(f"{np.sin(0.01 * k * (c + 1)):.6f}" for c in range(width - 1))] for k in range(rows)]
    for (row, column), text in (replace or {}).items():
        lines[row][column] = text
    path.write_text("\n".join([header, *(",".join(line) for line in lines)]) + "\n")
    return path


def positions(n: int) -> str:
    return "t," + ",".join(f"q{k + 1}" for k in range(n)) + "," + ",".join(f"tau{k + 1}" for k in range(n))


def raises(path: object, *texts: str, robot: Robot | None = None, columns: object = None, code: int = 3) -> None:
    with pytest.raises(IdentError) as caught:
        read_logs(path, robot, columns)  # type: ignore[arg-type]
    message = str(caught.value)
    assert caught.value.exit_code == code, message
    for text in texts:
        assert text in message, message


def test_missing_file(tmp_path: Path) -> None:
    raises(tmp_path / "none.csv", "none.csv", "no such file")


def test_pattern_without_match(tmp_path: Path) -> None:
    raises(str(tmp_path / "*.csv"), "no file matches")


def test_folder(tmp_path: Path) -> None:
    raises(tmp_path, "folder", "*.csv")


def test_empty_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").touch()
    raises(tmp_path / "a.csv", "a.csv", "empty")


def test_blank_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\n\n")
    raises(tmp_path / "a.csv", "no header")


def test_header_only(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,q1,tau1\n")
    raises(tmp_path / "a.csv", "header", "no row of data")


def test_no_header(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("0.0,1.0,2.0\n0.1,1.0,2.0\n")
    raises(tmp_path / "a.csv", "line 1", "header")


def test_not_text(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\x80\x81\xff\xfe" * 100)
    raises(tmp_path / "a.csv", "not a text table")


def test_damaged_gzip(tmp_path: Path) -> None:
    import gzip

    whole = gzip.compress(("t,q1,tau1\n" + "0.1,2.0,3.0\n" * 100000).encode())
    (tmp_path / "a.csv.gz").write_bytes(whole[: len(whole) // 2])
    raises(tmp_path / "a.csv.gz", "a.csv.gz")


@pytest.mark.parametrize("count", [5, 7])
def test_wrong_joint_count(tmp_path: Path, robot: Robot, count: int) -> None:
    path = csv(tmp_path / "a.csv", positions(count))
    expected = "missing: q6 (j6)" if count == 5 else "too many: q7"
    raises(path, "wrong joint count", "6 joints", f"positions of {count}", expected, robot=robot)


def test_hole_in_the_numbering(tmp_path: Path) -> None:
    raises(csv(tmp_path / "a.csv", "t,q1,q3,tau1"), "missing: q2")


def test_joints_counted_from_zero(tmp_path: Path) -> None:
    raises(csv(tmp_path / "a.csv", "t,q0,q1,tau0"), "counted from 1")


def test_no_position(tmp_path: Path) -> None:
    raises(csv(tmp_path / "a.csv", "t,slope,torque"), "no joint position", "slope", "[columns]")


def test_no_time(tmp_path: Path) -> None:
    raises(csv(tmp_path / "a.csv", "when,q1,tau1"), "no time column", "Columns not understood: when.", "[columns]")


def test_column_twice(tmp_path: Path) -> None:
    raises(csv(tmp_path / "a.csv", "t,q1,q1,tau1"), "more than once", "q1")


def test_wrong_unit(tmp_path: Path) -> None:
    raises(csv(tmp_path / "a.csv", "t,q1_Nm,tau1"), "q1_Nm", "not a unit of position", code=2)


def test_degrees_for_a_slide(tmp_path: Path) -> None:
    slide = Robot.from_urdf(
        '<robot name="s"><link name="a"/><link name="b"/><joint name="x" type="prismatic">'
        '<parent link="a"/><child link="b"/><axis xyz="1 0 0"/></joint></robot>'
    )
    raises(csv(tmp_path / "a.csv", "t,q1_deg,tau1"), "q1_deg", "'x' is prismatic", robot=slide, code=2)
    log = read_logs(csv(tmp_path / "b.csv", "t,q1_rad,tau1"), slide)[0]
    assert any("taken as SI" in note for note in log.notes), "a scale of one does no harm and is said"


def test_mapped_column_that_is_not_there(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,shoulder_angle,tau1")
    raises(path, "shoulder_angel", "did you mean 'shoulder_angle'", columns={"q1": "shoulder_angel"}, code=2)


def test_mapped_quantity_that_is_none(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,a,tau1")
    raises(path, "unknown quantity", "'position1'", columns={"position1": "a"}, code=2)


def test_mapping_of_a_wrong_kind(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,a,tau1")
    raises(path, "[columns] q1", "as text, not 3", "q1_deg", columns={"q1": 3}, code=2)
    raises(path, "[columns] q1", "'units'", columns={"q1": {"column": "a", "units": "deg"}}, code=2)
    raises(path, "[columns] q1", "'degree'; did you mean 'deg'", columns={"q1": {"column": "a", "unit": "degree"}}, code=2)


@pytest.mark.parametrize("text", ["0.1x", "1_0.5", "１"])
def test_text_in_a_number_names_the_place(text: str, tmp_path: Path) -> None:
    """Python reads underscores and digits of other scripts; tables of numbers have none."""
    path = csv(tmp_path / "a.csv", "t,q1,tau1", replace={(16, 1): text})
    raises(path, "a.csv", "column 'q1'", "line 18", "data row 17", f"'{text}' is not a number")


def test_too_many_fields_names_the_line(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1", replace={(9, 2): "1.0,2.0"})
    raises(path, "line 11", "4 fields")


def test_block_of_missing_positions(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1", rows=500, replace={(k, 1): "nan" for k in range(100, 160)})
    raises(path, "column 'q1'", "60 of 500 rows", "data rows 101-160", "missing")


def test_time_backwards(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1", replace={(30, 0): "0.05"})
    raises(path, "time runs backwards at data row 31")


@pytest.mark.parametrize("mark", [" ", "   "])
def test_runs_of_spaces_separate_columns(tmp_path: Path, mark: str) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1")
    whole = read_logs([path])[0]
    path.write_text(path.read_text().replace(",", mark))
    assert read_logs([path])[0].q.tolist() == whole.q.tolist()


def test_other_separators_are_named(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1")
    path.write_text("t q1 tau1\n" + path.read_text().replace(",", "  ").split("\n", 1)[1].replace("  ", " x  "))
    raises(path, "a.csv", "separated by spaces", "with commas")


@pytest.mark.parametrize("first", ["sep=;", '"sep=;"', "SEP=;", "sep=\t"])
def test_a_first_line_may_tell_what_separates_fields(tmp_path: Path, first: str) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1")
    plain = read_logs(path)[0]
    path.write_text(first + "\n" + path.read_text().replace(",", first.strip('"')[-1]))
    log = read_logs(path)[0]
    assert np.array_equal(log.q, plain.q)
    assert np.array_equal(log.t, plain.t)


def test_time_stands(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1", replace={(k, 0): "1.0" for k in range(50)})
    raises(path, "time stamp is the same")


def test_unknown_treatment(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,q1,tau1")
    with pytest.raises(ConfigurationError, match="did you mean 'refuse'"):
        read_logs(path, missing="refused")


def test_old_matlab_only(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"not a mat file at all, but long enough to be looked at " * 10)
    with pytest.raises(DataError, match=r"a\.mat"):
        read_logs(tmp_path / "a.mat")


def test_tables_that_are_no_text(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_bytes(b"\xff\xfe" + "t,q1,tau1\n0,0.1,1.5\n".encode("utf-16-le")[:-1])
    with pytest.raises(DataError, match="begins like UTF-16, but is not"):
        read_logs([path])
    path.write_bytes(b"t,q1,tau1\n0,0.1,\x80\n")
    with pytest.raises(DataError, match="is not a number"):
        read_logs([path])


def test_dates_are_no_times(tmp_path):
    path = tmp_path / "dates.csv"
    path.write_text("t,q1,tau1\n2026-03-01T08:00:00.000,0.1,1.5\nyesterday,0.2,1.6\n")
    with pytest.raises(DataError, match=r"column 't', data row 2: 'yesterday' is not a date with a time"):
        read_logs([path])
    path.write_text("t,q1,tau1\n0,0.1,1.5\n2026-03-01T08:00:00.010,0.2,1.6\n")
    with pytest.raises(DataError, match=r"line 3 .*is not a number\. It is a date with a time: write times in seconds"):
        read_logs([path])
    path.write_text("t,q1,tau1\n2026-03,0.1,1.5\n2026-03,0.2,1.6\n")
    with pytest.raises(DataError, match=r"is not a number\. Correct or remove the row"):
        read_logs([path])


@pytest.mark.parametrize(
    ("columns", "remedy"),
    [
        ("stamp,rot_1_deg,rot_2_deg,force", "no joint position found"),
        ("stamp,force", 'for example t = "clock", q1 = "angle 1", tau1 = "torque 1"'),
    ],
)
def test_columns_that_look_like_positions_are_asked_about(tmp_path, columns, remedy):
    path = tmp_path / "unknown.csv"
    path.write_text(f"{columns}\n" + "".join(",".join("0" for _ in columns.split(",")) + "\n" for _ in range(3)))
    with pytest.raises(DataError, match=remedy):
        read_logs([path])


def test_a_decimal_comma_is_told_as_one(tmp_path):
    path = tmp_path / "comma.csv"
    path.write_text("t;q1;tau1\n0,00;0,1;1,5\n0,01;0,2;1,6\n")
    assert read_logs([path])[0].q[:, 0].tolist() == [0.1, 0.2]
    path.write_text("t,q1;tau1\n0,00;0,1\n0,01;0,2\n")
    with pytest.raises(DataError):
        read_logs([path])


@pytest.mark.parametrize("call", [audit, ZeroPhase()], ids=["audit", "preparation"])
def test_a_name_is_no_robot(call: Callable[..., object]) -> None:
    """It ended in an AttributeError."""
    train, _ = demo_logs()
    for calling in (lambda: call(train, "puma560"), lambda: read_logs("a.csv", "ur5")):
        with pytest.raises(ConfigurationError, match=r"a robot is needed, not .*ident\.load_robot"):
            calling()


@pytest.mark.parametrize(
    ("spoiled", "said"),
    [
        (lambda cells: [cells[0], "x", *cells[2:]], r"'j1\.position_deg'.* line 22 .*'x' is not a number"),
        (lambda cells: [*cells, "7"], r"line 22 .* 6 fields, but the header has 5"),
        (lambda cells: ["abc", *cells[1:]], r"'stamp_ns'.* line 22 .*'abc' is not a number"),
    ],
)
def test_rows_are_at_fault_and_not_names_that_are_recognised(tmp_path: Path, spoiled: Callable[[list[str]], list[str]], said: str) -> None:
    """A file that is read by what its columns are like once blamed its time, whatever a row held."""
    rows = [[f"{1732700000000000000 + i * 5000000}", f"{30 * np.sin(0.05 * i):.5f}", f"{np.cos(0.05 * i):.5f}"] for i in range(200)]
    cells = [[*row, f"{20 * np.sin(0.07 * i):.5f}", f"{np.sin(0.07 * i):.5f}"] for i, row in enumerate(rows)]
    head = "stamp_ns;j1.position_deg;j1.torque_Nm;j2.position_deg;j2.torque_Nm"
    robot = chain(2)
    right = tmp_path / "right.csv"
    right.write_text("\n".join([head, *(";".join(x) for x in cells)]))
    log = read_logs(right, robot)[0]
    assert log.t[-1] - log.t[0] == pytest.approx(199 * 0.005)
    cells[20] = spoiled(cells[20])
    wrong = tmp_path / "wrong.csv"
    wrong.write_text("\n".join([head, *(";".join(x) for x in cells)]))
    with pytest.raises(DataError, match=said):
        read_logs(wrong, robot)
