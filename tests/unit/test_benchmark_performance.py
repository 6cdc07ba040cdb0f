"""The benchmark of the fast core: its verdicts, and small runs of its parts."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rigid_models import needs_native

from benchmarks.performance import estimation, kernel, live, ratios, reading, startup, timing
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


@needs_native
def test_operations_are_counted_row_by_row() -> None:
    case = puma(300)
    factors = case.information("triangle")
    live = [int((np.abs(R).max(axis=0) > 0).sum()) for R in factors]
    assert products(case) == sum(w * (w + 1) for w in live)
    assert len(information_limit(case, 256).parts) == 2


def test_live_calls_and_start_up_have_rows() -> None:
    rows, jitter = live.live_rows(200)
    assert sum(row["calls"] for row in jitter) == 200
    assert sum(row["share"] for row in jitter) == pytest.approx(1.0)
    assert [row.unit for row in rows] == ["µs"] * 3
    assert all(row.measured > 0 for row in rows)
    assert "numpy" in startup.slowest_imports(["-c", "import numpy"])


@needs_native
def test_an_arm_is_measured_against_its_own_limit() -> None:
    (row,) = kernel.arm_rows([2], 64)
    assert row.target is not None
    assert row.measured > 0


class _Told:
    """Work of which each call takes what it is told, by a clock of its own."""

    def __init__(self, *seconds: float) -> None:
        self.seconds, self.now = [seconds[0], *seconds], 0.0  # the first call only fills caches

    def call(self) -> None:
        self.now += self.seconds.pop(0) if len(self.seconds) > 1 else self.seconds[0]

    def work(self) -> timing.Work:
        return timing.Work(self.call, 1, lambda: self.now)


def group(ours: _Told, theirs: _Told) -> ratios.Group:
    return ratios.Group({"ours": ours.work(), "theirs": theirs.work()}, {"ours / theirs": ("ours", "theirs")})


def test_the_median_of_the_turns_counts() -> None:
    found = timing.together({"": _Told(3.0, 1.0, 9.0, 2.0, 9.0).work()}, rounds=5, budget=0.0)
    assert found[""] == pytest.approx(3e6)


def test_a_ratio_is_one_of_least_times() -> None:
    ours = _Told(8.0, 4.0, 6.0, 9.0, 9.0)
    assert group(ours, _Told(2.0)).measured() == {"ours / theirs": pytest.approx(2.0)}


def test_what_is_slow_once_is_measured_again_and_what_stays_slow_is_a_regression() -> None:
    wanted = {"ours / theirs": 2.0}
    once = _Told(*[9.0] * 5, *[4.0] * 6)
    assert ratios.compared([group(once, _Told(2.0))], wanted)["ours / theirs"] == pytest.approx(2.0)
    always = ratios.compared([group(_Told(5.2), _Told(2.0))], wanted)["ours / theirs"]
    assert ratios.beyond(always, 2.0)
    assert not ratios.beyond(2.4, 2.0)
    assert not ratios.beyond(1e9, None)


@pytest.mark.parametrize(("known", "status"), [("mine", 1), ("another", 0), ("", 0)])
def test_a_regression_fails_on_the_machine_that_was_recorded_alone(known: str, status: int, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(ratios, "GROUPS", (lambda: group(_Told(6.0), _Told(2.0)),))
    record = tmp_path / "ratios.json"
    if known:
        key = ratios.machine_key() if known == "mine" else "another, avx512"
        record.write_text(json.dumps({key: {"recorded": "2026-01-01", "ratios": {"ours / theirs": 2.0}}}))
    assert ratios.check(record) == status
    assert ("more than 25% worse" in capsys.readouterr().out) == bool(status)


@needs_native
def test_every_recorded_ratio_is_still_measured() -> None:
    names = {name for make in ratios.GROUPS for name in make().pairs}
    assert all(set(machine["ratios"]) == names for machine in ratios.recorded().values())
    assert ratios.recorded()
