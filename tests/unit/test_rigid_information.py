"""Information of many samples by every kernel there is, against the stacked matrix."""

from __future__ import annotations

import os

import numpy as np
import pytest
from rigid_models import kernels, random_model, states, tree_of, using

import ident
from ident.errors import ConfigurationError, DataError, UnsupportedError
from ident.regressor import rigid, row_information
from ident.regressor.numpy_dynamics import regressor as plain_regressor


@pytest.fixture(scope="module")
def puma():
    return ident.load_robot("puma560")


def case(seed: int, n: int, floating: bool = False, dense: bool = False, masked: bool = True, weighted: bool = True):
    """Arguments of `information` and the stacked weighted rows (N, R, k+1) they stand for."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, int(rng.integers(1, 8)), floating)
    tree = tree_of(model)
    q, dq, ddq = states(model, rng, n)
    r, e = int(rng.integers(1, tree.nv + 1)), 4
    rows = rng.normal(size=(r, tree.nv)) * (rng.random((r, tree.nv)) < 0.6)
    pattern = rng.normal(size=(r, e)) * (rng.random((r, e)) < 0.6)
    extra = rng.normal(size=(n, e))
    given = {"extra": extra, "pattern": pattern}
    beside = extra[:, None, :] * pattern
    if dense:
        given = {"extra": beside}
    columns = rng.permutation(10 * tree.nb + e)[: rng.integers(1, 10 * tree.nb + e + 1)]
    tau = rng.normal(size=(n, r))
    rigid_columns = np.einsum("rv,nvc->nrc", rows, plain_regressor(tree, q, dq, ddq))
    stacked = np.concatenate([np.concatenate([rigid_columns, beside], axis=2)[:, :, columns], tau[:, :, None]], axis=2)
    valid = rng.random((n, r)) < 0.7 if masked else None
    weight = rng.random((n, r)) if weighted else None
    factor = (1.0 if valid is None else valid) * (np.ones((n, r)) if weight is None else weight)
    if valid is not None:
        tau = np.where(valid, tau, np.nan)
    arguments = {
        "tree": tree,
        "q": q,
        "dq": dq,
        "ddq": ddq,
        "tau": tau,
        "rows": rows,
        "columns": columns,
        "valid": valid,
        "weight": weight,
        **given,
    }
    return arguments, stacked * factor[:, :, None]


def normal(stacked):
    return np.einsum("nrc,nrd->rcd", stacked, stacked)


def error(found, wanted):
    """Largest difference of two Gram matrices, each entry relative to the lengths of its two columns.

    Columns of rounding errors of the trigonometry (1e-16 of the others) count as zero: the kernel leaves them out."""
    length = np.sqrt(np.einsum("rcc->rc", wanted))
    length = np.maximum(length, 1e-3 * length.max(axis=1, initial=1e-100, keepdims=True))
    return float((np.abs(found - wanted) / (length[:, :, None] * length[:, None, :])).max(initial=0.0))


def filtered(stacked, taps, factor):
    """Rows with full support, as the definition has it."""
    count = max(0, (len(stacked) - len(taps)) // factor + 1)
    out = np.zeros((count, *stacked.shape[1:]))
    for m in range(count):
        out[m] = np.tensordot(taps, stacked[m * factor : m * factor + len(taps)], 1)
    return out


@pytest.fixture(params=kernels())
def kernel(request, monkeypatch):
    monkeypatch.setenv("IDENT_KERNEL", "numpy" if request.param == "numpy" else "native")
    with using(request.param):
        yield request.param


@pytest.mark.parametrize("form", ["triangle", "gram"])
@pytest.mark.parametrize("seed", range(12))
def test_equals_stacked_matrix(kernel, form, seed):
    n = [1, 3, 8, 31, 257, 700][seed % 6]
    arguments, stacked = case(seed, n, floating=seed % 2 == 1, dense=seed % 3 == 0, masked=seed % 4 != 0, weighted=seed % 5 == 0)
    found, counts = row_information.information(**arguments, form=form, threads=1)
    if form == "triangle":
        assert not np.tril(found, -1).any()
        found = np.swapaxes(found, 1, 2) @ found
    assert error(found, normal(stacked)) < 1e-12
    valid = arguments["valid"]
    assert np.array_equal(counts, np.full(stacked.shape[1], n) if valid is None else valid.sum(axis=0))


@pytest.mark.parametrize("form", ["triangle", "gram"])
@pytest.mark.parametrize(
    ("size", "factor", "n"), [(1, 1, 9), (5, 1, 300), (51, 7, 900), (200, 20, 2999), (3, 10, 700), (129, 64, 4000), (30, 16, 29)]
)
def test_filtered_rows(kernel, form, size, factor, n):
    """Filter and decimation on the way equal those of written-out columns; masks and weights are of the rows."""
    arguments, stacked = case(size + factor, n, dense=size == 51, masked=False, weighted=False, floating=factor == 7)
    rng = np.random.default_rng(size)
    taps = rng.normal(size=size)
    wanted = filtered(stacked, taps, factor)
    shape = wanted.shape[:2]
    tau, valid, weight = rng.normal(size=shape), rng.random(shape) < 0.8, rng.random(shape)
    wanted[:, :, -1] = tau
    wanted *= (valid * weight)[:, :, None]
    arguments |= {"tau": np.where(valid, tau, np.nan), "valid": valid, "weight": weight}
    found, counts = row_information.information(**arguments, taps=taps, factor=factor, form=form)
    if form == "triangle":
        found = np.swapaxes(found, 1, 2) @ found
    assert error(found, normal(wanted)) < 1e-12
    assert np.array_equal(counts, valid.sum(axis=0))


def row_columns(tree, q, dq, ddq, **given):
    """The packed columns where they belong, among zeros."""
    packed, live = row_information.packed_columns(tree, q, dq, ddq, **given)
    extra, columns = given.get("extra"), given.get("columns")
    width = 10 * tree.nb + (0 if extra is None else np.shape(extra)[-1]) if columns is None else len(columns)
    out, start = np.zeros((len(packed), len(live), width)), 0
    for row, shown in enumerate(live):
        out[:, row, shown] = packed[:, start : start + len(shown)]
        start += len(shown)
    return out


@pytest.mark.parametrize(
    ("size", "factor", "n"), [(None, 1, 9), (None, 1, 2300), (51, 7, 900), (200, 20, 2999), (739, 132, 9000), (30, 16, 29)]
)
def test_columns_of_filtered_rows(kernel, size, factor, n):
    """The rows themselves: what `information` takes the products of."""
    arguments, stacked = case(factor + n, n, dense=n == 900, masked=False, weighted=False, floating=factor == 7)
    taps = None if size is None else np.random.default_rng(n).normal(size=size)
    wanted = (stacked if taps is None else filtered(stacked, taps, factor))[:, :, :-1]
    for name in ("tau", "valid", "weight"):
        arguments.pop(name)
    found = row_columns(**arguments, taps=taps, factor=factor, threads=2)
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max(initial=0.0) < 1e-13 * np.abs(stacked).max(initial=1.0) * (1 if taps is None else np.abs(taps).sum())


def test_columns_refuse_what_is_not_finite(kernel, puma):
    rng = np.random.default_rng(0)
    good = dict(zip(("q", "dq", "ddq"), rng.normal(size=(3, 900, 6)), strict=True)) | {"extra": rng.normal(size=(900, 6))}
    for name in good:
        bad = good[name].copy()
        bad[811, 3] = np.inf
        with pytest.raises(DataError, match=rf"{name}: 1 value\(s\) are not finite, the first at \[811, 3\]"):
            row_columns(puma.tree, **{**good, name: bad}, pattern=np.eye(6), taps=np.hanning(101), factor=10)
    with pytest.raises(DataError, match="overflows"):
        row_columns(puma.tree, good["q"], good["dq"] * 1e200, good["ddq"])
    assert row_columns(puma.tree, *np.zeros((3, 50, 6)), taps=np.ones(51)).shape == (0, 6, 60)


def test_filtered_rows_by_threads(kernel, puma):
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 12000, 6))
    taps = np.hanning(101)
    tau = rng.normal(size=((12000 - 101) // 10 + 1, 6))
    one, two = (row_information.information(puma.tree, q, dq, ddq, tau, taps=taps, factor=10, form="gram", threads=t)[0] for t in (1, 2))
    assert error(two, one) < 1e-13
    bad = dq.copy()
    bad[11345, 2] = np.nan
    with pytest.raises(DataError, match=r"dq: 1 value\(s\) are not finite, the first at \[11345, 2\]"):
        row_information.information(puma.tree, q, bad, ddq, tau, taps=taps, factor=10)


@pytest.mark.parametrize("form", ["triangle", "gram"])
def test_columns_that_are_there(kernel, form):
    rng = np.random.default_rng(0)
    columns, tau = rng.normal(size=(500, 3, 7)), rng.normal(size=(500, 3))
    columns[:, 1, 4] = 0.0
    valid, weight = rng.random((500, 3)) < 0.9, rng.random((500, 3))
    wanted = normal(np.concatenate([columns, tau[:, :, None]], axis=2) * (valid * weight)[:, :, None])
    columns[~valid], tau[~valid] = np.nan, np.inf
    found, counts = row_information.stacked_information(columns, tau, valid=valid, weight=weight, form=form)
    assert error(np.swapaxes(found, 1, 2) @ found if form == "triangle" else found, wanted) < 1e-13
    assert np.array_equal(counts, valid.sum(axis=0))
    with pytest.raises(DataError, match=r"columns: \d+ value"):
        row_information.stacked_information(columns, np.zeros((500, 3)))


def test_two_motions_at_once(kernel):
    """Instruments against regressor: the products of two motions' columns from one pass over a paired tree."""
    rng = np.random.default_rng(0)
    model = random_model(rng, 5, False)
    tree = tree_of(model)
    (q, dq, ddq), (p, dp, ddp) = states(model, rng, 200), states(model, rng, 200)
    tau = rng.normal(size=(200, 5))
    Z, Y = plain_regressor(tree, p, dp, ddp), plain_regressor(tree, q, dq, ddq)
    motion = [np.concatenate(pair, axis=1) for pair in ((p, q), (dp, dq), (ddp, ddq))]
    found, _ = row_information.information(row_information.paired(tree), *motion, tau, rows=np.tile(np.eye(5), 2), form="gram")
    assert error(found, normal(np.concatenate([Z, Y, tau[:, :, None]], axis=2))) < 1e-12
    given = {"rows": np.tile(np.eye(5), 2), "form": "gram"}
    mixed, _ = row_information.information(row_information.paired(tree), *motion, tau, **given, split=Z.shape[2])
    part = np.zeros(found.shape)
    part[:, : Z.shape[2], Z.shape[2] :] = found[:, : Z.shape[2], Z.shape[2] :]
    assert np.array_equal(mixed, part) or kernel == "numpy"
    assert error(mixed + found - part, found) < 1e-12
    threads, _ = row_information.information(row_information.paired(tree), *motion, tau, **given, split=Z.shape[2], threads=2)
    assert error(threads + found - part, found) < 1e-12
    with pytest.raises(ConfigurationError, match="split=3"):
        row_information.information(row_information.paired(tree), *motion, tau, rows=given["rows"], split=3)
    with pytest.raises(UnsupportedError):
        row_information.paired(tree_of(random_model(rng, 2, True)))


def test_triangle_keeps_small_singular_values(kernel, puma):
    """A direction 1e-11 of the others: visible in the triangle (QR-grade), lost in a Gram matrix."""
    rng = np.random.default_rng(0)
    n = 1000
    a = rng.normal(size=(n, 1))
    extra = np.concatenate([a, a + 1e-11 * rng.normal(size=(n, 1))], axis=1)
    q = rng.normal(size=(n, 6))
    factors, _ = row_information.information(
        puma.tree, q, q, q, np.zeros((n, 6)), columns=[60, 61], extra=extra, pattern=np.ones((6, 2)), form="triangle"
    )
    wanted = np.linalg.svd(extra, compute_uv=False)
    found = np.linalg.svd(factors[2][:2, :2], compute_uv=False)
    assert found[1] == pytest.approx(wanted[1], rel=1e-4)


def test_threads_agree_and_repeat(kernel, puma):
    rng = np.random.default_rng(0)
    size = 1000 if os.environ.get("IDENT_KERNEL") == "numpy" else 9000  # NumPy has one way for any number of threads
    q, dq, ddq, tau = rng.normal(size=(4, size, 6))
    runs = {t: [row_information.information(puma.tree, q, dq, ddq, tau, threads=t)[0] for _ in range(2)] for t in (1, 2, 3)}
    for first, second in runs.values():
        assert np.array_equal(first, second)
    wanted = np.swapaxes(runs[1][0], 1, 2) @ runs[1][0]
    for t in (2, 3):
        assert error(np.swapaxes(runs[t][0], 1, 2) @ runs[t][0], wanted) < 1e-13
    values = [rigid.regressor(puma.tree, q, dq, ddq, threads=t) for t in (1, 2)]
    assert np.array_equal(*values)


def test_solves_puma_on_the_motor_side(kernel, puma):
    """Base columns and drive columns, coupled gears: the truth comes back from the factors."""
    rng = np.random.default_rng(4)
    n = 3000
    K = puma.transmission.K
    q, dq, ddq = rng.normal(size=(3, n, 6))
    speed = dq @ np.linalg.inv(K).T
    base = _independent(puma)
    extra = np.concatenate([speed, np.sign(speed)], axis=1)
    pattern = np.concatenate([np.eye(6), np.eye(6)], axis=1)
    columns = np.concatenate([base, 60 + np.arange(12)])
    truth = rng.normal(size=len(columns))
    inertia = np.zeros(60)
    inertia[base] = truth[: len(base)]
    tau = rigid.inverse_dynamics(puma.tree, inertia, q, dq, ddq) @ K + extra[:, :6] * truth[-12:-6] + extra[:, 6:] * truth[-6:]
    factors, counts = row_information.information(puma.tree, q, dq, ddq, tau, rows=K.T, columns=columns, extra=extra, pattern=pattern)
    assert counts.tolist() == [n] * 6
    R = np.linalg.qr(np.concatenate([f / np.linalg.norm(f[:, -1]) for f in factors]), mode="r")
    scale = np.linalg.norm(R[:, :-1], axis=0)
    found = np.linalg.solve(R[:-1, :-1] / scale, R[:-1, -1]) / scale
    assert len(base) == 36
    assert np.abs(found - truth).max() < 1e-9


def _independent(robot):
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 100, 6))
    Y = plain_regressor(robot.tree, q, dq, ddq).reshape(-1, 60)
    length = np.linalg.norm(Y, axis=0)
    Y = np.divide(Y, length, out=np.zeros_like(Y), where=length > 1e-9 * length.max())
    order = [10 * i + k for i in range(6) for k in (9, 4, 5, 7, 8, 1, 2, 3, 6, 0)]
    diagonal = np.abs(np.diag(np.linalg.qr(Y[:, order], mode="r")))
    return np.sort(np.array(order)[diagonal > 1e-8])


def test_no_sample_and_no_valid_row(kernel, puma):
    empty = np.zeros((0, 6))
    factors, counts = row_information.information(puma.tree, empty, empty, empty, empty)
    assert factors.shape == (6, 61, 61)
    assert not factors.any()
    assert not counts.any()
    q = np.ones((5, 6))
    factors, counts = row_information.information(puma.tree, q, q, q, np.full((5, 6), np.nan), valid=np.zeros((5, 6), bool))
    assert not factors.any()
    assert not counts.any()


def test_input_that_is_not_finite_is_refused(kernel, puma):
    """Wherever it stands, used or not, in whatever lane; torques that are masked may be anything."""
    rng = np.random.default_rng(0)
    n = 700
    good = dict(zip(("q", "dq", "ddq", "tau"), rng.normal(size=(4, n, 6)), strict=True))
    good["extra"] = rng.normal(size=(n, 5))
    fixed = {"pattern": np.eye(6, 5), "columns": [59]}
    for name in ("q", "dq", "ddq", "extra", "tau"):
        for sample, value in ((0, np.nan), (n - 1, np.inf), (333, -np.inf)):
            bad = good[name].copy()
            bad[sample, 4] = value
            with pytest.raises(DataError, match=rf"{name}: 1 value\(s\) are not finite, the first at \[{sample}, 4\]"):
                row_information.information(puma.tree, **{**good, name: bad}, **fixed)
    with pytest.raises(DataError, match="overflows"):
        row_information.information(puma.tree, **{**good, "tau": good["tau"] * 1e200}, **fixed, form="gram")


def test_refusals(puma):
    q = np.zeros((4, 6))
    call = {"tree": puma.tree, "q": q, "dq": q, "ddq": q}
    with pytest.raises(DataError, match="tau"):
        row_information.information(**call, tau=np.full((4, 6), np.nan))
    with pytest.raises(DataError, match="extra"):
        row_information.information(**call, tau=q, extra=np.full((4, 1), np.inf), pattern=np.ones((6, 1)))
    with pytest.raises(ConfigurationError, match=r"tau: expected shape \(4, 2\)"):
        row_information.information(**call, tau=q, rows=np.ones((2, 6)))
    with pytest.raises(ConfigurationError, match=r"rows: expected shape \(R, 6\)"):
        row_information.information(**call, tau=q, rows=np.ones((2, 5)))
    with pytest.raises(ConfigurationError, match="columns: expected indices from 0 to 59"):
        row_information.information(**call, tau=q, columns=[60])
    with pytest.raises(ConfigurationError, match="twice"):
        row_information.information(**call, tau=q, columns=[3, 3])
    with pytest.raises(ConfigurationError, match="extra: expected shape"):
        row_information.information(**call, tau=q, extra=np.ones((4, 2)))
    with pytest.raises(ConfigurationError, match="valid: expected bool"):
        row_information.information(**call, tau=q, valid=np.ones((4, 6)))
    with pytest.raises(ConfigurationError, match=r"taps: expected shape \(T,\)"):
        row_information.information(**call, tau=q, taps=np.ones((2, 2)))
    with pytest.raises(ConfigurationError, match="factor=0"):
        row_information.information(**call, tau=q, taps=np.ones(3), factor=0)
    with pytest.raises(ConfigurationError, match=r"tau: expected shape \(2, 6\)"):
        row_information.information(**call, tau=q, taps=np.ones(3))
    with pytest.raises(ConfigurationError, match="form='svd'"):
        row_information.information(**call, tau=q, form="svd")  # type: ignore[arg-type]
