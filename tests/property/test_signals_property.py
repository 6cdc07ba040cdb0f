"""Properties that hold for any filter, log and split."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.logs.columns import resolve_columns
from ident.logs.log import Log, LogSet
from ident.logs.units import UNITS, expected_units
from ident.robots.robot import Robot
from ident.signals.filters import RowFilter, central_differences
from ident.signals.resample import Clock, grid, interpolate, is_even, stretches, thin
from ident.signals.signals import PreparationReport, Signals

ONE = Robot.from_urdf(
    '<robot name="one"><link name="a"/><link name="b"/><joint name="x" type="revolute"><parent link="a"/><child link="b"/>'
    '<axis xyz="0 0 1"/></joint></robot>'
)
REPORT = PreparationReport({}, None, "", None, 1.0, 1.0, 0, 0, 0, "", ())


@st.composite
def row_filters(draw: st.DrawFn) -> RowFilter:
    half = draw(st.integers(0, 40))
    side = np.array(draw(st.lists(st.floats(-1, 1), min_size=half, max_size=half)))
    return RowFilter(np.r_[side, 1.0, side[::-1]], draw(st.integers(1, 25)))


def signals_of(runs: list[int], row_filter: RowFilter | None, seed: int) -> Signals:
    rng = np.random.default_rng(seed)
    total = sum(runs)
    edges = np.cumsum([0, *runs])
    slices = tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(edges))
    x = rng.standard_normal((total, 1))
    rows = [x[s] if row_filter is None else row_filter.apply(x[s]) for s in slices]
    tau = np.concatenate(rows)
    names = tuple(f"r{i}" for i in range(len(runs)))
    valid = np.ones(tau.shape, bool)
    return Signals(ONE, np.arange(total) * 1.0, x, x, x, x, tau, valid, slices, names, 1.0, row_filter, REPORT)


@settings(max_examples=60, deadline=None)
@given(
    row_filter=st.one_of(st.none(), row_filters()),
    runs=st.lists(st.integers(1, 400), min_size=1, max_size=4),
    samples=st.one_of(st.none(), st.integers(1, 600)),
    seed=st.integers(0, 99),
)
def test_blocks_cover_every_row_once_and_exactly(row_filter: RowFilter | None, runs: list[int], samples: int | None, seed: int) -> None:
    signals = signals_of(runs, row_filter, seed)
    seen = np.zeros(len(signals.tau), int)
    for block in signals.blocks(samples):
        np.testing.assert_allclose(block.reduce(signals.q[block.samples]), signals.tau[block.rows], atol=1e-12)
        seen[block.rows] += 1
        assert signals.row_runs[block.run].start <= block.rows.start
        assert block.rows.stop <= signals.row_runs[block.run].stop
    assert (seen == 1).all()
    assert len(signals.row_time) == len(signals.tau)


@settings(max_examples=60, deadline=None)
@given(row_filter=row_filters(), runs=st.lists(st.integers(60, 400), min_size=1, max_size=3), data=st.data())
def test_selected_rows_stay_what_they_were(row_filter: RowFilter, runs: list[int], data: st.DataObject) -> None:
    signals = signals_of(runs, row_filter, 0)
    chosen = []
    for rows in signals.row_runs:
        if rows.stop > rows.start:
            a = data.draw(st.integers(rows.start, rows.stop - 1))
            chosen.append(slice(a, data.draw(st.integers(a + 1, rows.stop))))
    if not chosen:
        return
    part = signals.select_rows(chosen)
    kept = np.concatenate([np.arange(c.start, c.stop) for c in chosen])
    np.testing.assert_allclose(part.filtered(part.q), signals.tau[kept], atol=1e-12)
    np.testing.assert_array_equal(part.row_time, signals.row_time[kept])


@settings(max_examples=60, deadline=None)
@given(row_filter=row_filters(), length=st.integers(1, 500), shift=st.integers(0, 30), seed=st.integers(0, 99))
def test_row_filter_is_linear_and_moves_with_the_signal(row_filter: RowFilter, length: int, shift: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.standard_normal((2, length + shift * row_filter.factor, 2))
    np.testing.assert_allclose(row_filter.apply(2 * x - 3 * y), 2 * row_filter.apply(x) - 3 * row_filter.apply(y), atol=1e-10)
    np.testing.assert_allclose(row_filter.apply(x[shift * row_filter.factor :]), row_filter.apply(x)[shift:], atol=1e-12)
    if row_filter.count(len(x)):
        np.testing.assert_allclose(row_filter.apply(x[::-1])[0], row_filter.taps @ x[::-1][: len(row_filter.taps)], atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(accuracy=st.sampled_from([2, 4, 6, 8]), seed=st.integers(0, 99), rate=st.floats(1, 1e4))
def test_reversing_time_reverses_velocity_alone(accuracy: int, seed: int, rate: float) -> None:
    q = np.random.default_rng(seed).standard_normal((50, 2))
    v, a = central_differences(q, rate, accuracy)
    back_v, back_a = central_differences(q[::-1], rate, accuracy)
    np.testing.assert_allclose(back_v[::-1], -v, rtol=1e-9, atol=1e-9 * rate)
    np.testing.assert_allclose(back_a[::-1], a, rtol=1e-9, atol=1e-9 * rate**2)


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.floats(1e-4, 0.02), min_size=30, max_size=300),
    start=st.sampled_from([0.0, -5.0, 1.7e9]),
    longest=st.floats(1e-3, 0.05),
)
def test_resampling_stays_inside_and_honours_gaps(steps: list[float], start: float, longest: float) -> None:
    t = start + np.cumsum(steps)
    parts = stretches(t, longest)
    assert sum(p.stop - p.start for p in parts) == len(t)
    clock = Clock.of(t)
    for p in parts:
        piece = t[p]
        assert len(piece) == 1 or np.diff(piece).max() <= longest
        kept = piece[thin(piece, clock.step)]
        if len(kept) < 2:
            continue
        at = grid(kept, 1 / clock.step)
        assert at[0] == kept[0]
        assert at[-1] <= kept[-1] + 1e-5 * clock.step + 1e-6
        line = interpolate(kept, (3 * (kept - start) + 1)[:, None], at)
        np.testing.assert_allclose(line[:, 0], 3 * (at - start) + 1, atol=1e-5)


@settings(max_examples=40, deadline=None)
@given(rate=st.floats(10, 5000), count=st.integers(50, 2000), start=st.sampled_from([0.0, 3.7, 1e6]))
def test_even_clocks_are_seen_as_even(rate: float, count: int, start: float) -> None:
    t = start + np.arange(count) / rate
    clock = Clock.of(t)
    assert abs(clock.step * rate - 1) < 1e-6
    assert is_even(t, 1 / clock.step, clock)


@settings(max_examples=60, deadline=None)
@given(
    quantity=st.sampled_from(["t", "q", "dq", "ddq", "q_motor", "tau_joint", "tau_motor", "tau_current"]),
    data=st.data(),
    value=st.floats(-1e3, 1e3),
)
def test_every_unit_of_every_quantity_is_honoured(quantity: str, data: st.DataObject, value: float) -> None:
    unit = data.draw(st.sampled_from([u for u in UNITS.values() if u.dimension in expected_units(quantity)]))
    stem = {"t": "time", "q_motor": "q_m1", "tau_joint": "tau1", "tau_motor": "taum1", "tau_current": "i1"}.get(quantity, f"{quantity}1")
    name = f"{stem}_{unit.name}"
    header = [name] + [h for h, have in (("t", quantity == "t"), ("q1", quantity == "q")) if not have]
    plan = resolve_columns(header)
    arrays = plan.arrays({h: np.full(3, value) for h in header})
    np.testing.assert_allclose(arrays[quantity].reshape(-1), value * unit.scale)


@settings(max_examples=60, deadline=None)
@given(
    lengths=st.lists(st.integers(20, 200), min_size=1, max_size=5),
    by=st.sampled_from(["run", "fraction", "blocks"]),
    held=st.floats(0.1, 0.6),
)
def test_splits_neither_share_nor_lose_samples(lengths: list[int], by: str, held: float) -> None:
    logs = LogSet(
        tuple(Log(f"r{k}", k * 1e3 + np.arange(n) * 0.01, np.zeros((n, 1)), tau={"joint": np.zeros((n, 1))}) for k, n in enumerate(lengths))
    )
    if by == "run" and len(lengths) == 1:
        return
    fit, out = logs.split(by=by, held=held)
    times = [np.concatenate([log.t for log in part]) for part in (fit, out)]
    assert not set(times[0].tolist()) & set(times[1].tolist())
    assert len(times[0]) + len(times[1]) == sum(lengths)
