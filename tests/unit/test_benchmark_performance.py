"""The benchmark of the fast core: its verdicts, and small runs of its parts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.performance import estimation, kernel, live, reading, startup, timing
from benchmarks.performance.cases import puma
from benchmarks.performance.limits import Limit, information_limit, products, profiled
from benchmarks.performance.table import Row


def test_a_row_says_whether_its_target_is_met_and_why_not() -> None:
    others = (("a loop", 30.0, 80.0), ("another", 300.0, None))
    assert Row("work", 0.2, "µs", 0.2).misses == []
    assert Row("work", 0.2, "µs", 0.2).lines() == ["work: 0.2 µs; target 0.2 µs: met"]
    missed = Row("work", 0.5, "µs", 0.4, others, "arithmetic", "a note")
    assert missed.misses == ["missed by 25%", "60 x a loop, asked 80 x"]
    assert missed.lines()[-2:] == ["    why: arithmetic", "    a note"]
    assert Row("work", float("nan"), "µs", 1.0).misses == ["not measured"]
    assert Row("work", 1.0, "MB").lines() == ["work: 1 MB"]
    assert missed.to_dict()["misses"] == missed.misses


def test_works_are_timed_in_turn() -> None:
    order: list[str] = []
    works = {name: timing.Work(lambda name=name: order.append(name), 1) for name in "ab"}  # type: ignore[misc]
    found = timing.together(works, rounds=2)
    assert set(found) == {"a", "b"}
    assert all(us >= 0 for us in found.values())
    assert order[:4] == ["a", "b", "a", "b"]


def test_recursion_equals_filterpy() -> None:
    row = estimation.recursion_row(900)
    assert row.measured > 0
    gap = float(row.note.split(" samples to ")[1].split(" std")[0])
    assert gap < 0.1  # 900 samples leave filterpy's prior a part of a standard deviation


def test_formats_are_read_beside_their_libraries() -> None:
    pytest.importorskip("rosbags")
    pytest.importorskip("pyarrow")
    rows = reading.reading_rows(300)
    assert [row.work.split(" of ")[0] for row in rows] == ["Parquet", "Parquet with lists", "MCAP", "ROS 2 bag (SQLite)"]
    assert all(row.measured > 0 and row.others[0][1] > 0 for row in rows)


def test_what_is_compared_is_the_same_problem() -> None:
    """Factors of the kernel solve to the stacked matrix's lstsq."""
    case = puma(400)
    wanted = case.lstsq(400)
    stacked = case.information("triangle").reshape(-1, len(case.columns) + 1)
    R = np.linalg.qr(stacked, mode="r")
    assert np.linalg.solve(R[:-1, :-1], R[:-1, -1]) == pytest.approx(wanted, rel=1e-8, abs=1e-9)


def test_scaling_tables_have_a_row_each() -> None:
    assert [row["joints"] for row in kernel.by_joints([1, 2])] == [1, 2]
    assert [(row["samples"], row["threads"]) for row in kernel.by_samples([500], [1, 2])] == [(500, 1), (500, 2)]


def test_a_reason_is_made_of_what_was_measured() -> None:
    limit = Limit((("parsing", 3.0), ("4 operations", 1.0)))
    assert limit.value == 4.0
    assert limit.why(8.0, "s") == "of this run: parsing 3 s (38%), 4 operations 1 s (12%), the rest 4 s (50%)"
    assert limit.why(16.0, "s") != limit.why(8.0, "s")
    told = profiled(lambda: sorted(range(200_000), key=lambda i: -i), 1)
    assert told.startswith("profile of this run, own time: ")
    assert "%" in told


def test_operations_are_counted_row_by_row() -> None:
    case = puma(300)
    factors = case.information("triangle")
    live = [int((np.abs(R).max(axis=0) > 0).sum()) for R in factors]
    assert products(case) == sum(w * (w + 1) for w in live)
    assert len(information_limit(case, 256).parts) == 2


def test_live_calls_and_start_up_have_rows() -> None:
    rows = live.live_rows(200)
    assert [row.unit for row in rows] == ["µs"] * 3
    assert all(row.measured > 0 for row in rows)
    assert "numpy" in startup.slowest_imports(["-c", "import numpy"])
