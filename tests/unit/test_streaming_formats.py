"""Formats that are read in chunks give, chunk by chunk, what they give as a whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from formats import CHUNKED, ROBOT, UNTOLD, WHOLE, N, motion, written

from ident.errors import UnsupportedError
from ident.streaming import StreamedSession
from ident.study.session import Session
from ident.study.study import Study

Array = np.ndarray


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("arrays", "bag", "lists"):
        monkeypatch.setattr(f"ident.logs.readers.{module}.CHUNK", 250)
    monkeypatch.setattr("ident.logs.readers.bag._WAITING", 64)
    monkeypatch.setattr("ident.streaming.ingest._BLOCK", 300)


def study_of(path: Path, torque: str | None = None) -> Study:
    study = Study.from_flags(robot=ROBOT, logs=[path])
    drive = replace(study.description.drive, torque=torque, torque_sign=(1.0,))
    study = replace(study, description=replace(study.description, drive=drive))
    return replace(study, signals=replace(study.signals, options={"cutoff_hz": 12.0}))


@pytest.mark.parametrize("kind", CHUNKED)
def test_chunks_give_what_the_whole_gives(tmp_path: Path, kind: str) -> None:
    path = written(tmp_path, kind)
    study = study_of(path, "motor" if kind in UNTOLD else None)
    memory, streamed = Session(study), StreamedSession.of(study, out=tmp_path / "out")
    (one,), (other,) = memory.recorded, streamed.stored
    again = other.read(0, len(other))
    assert len(one) == N
    for name in ("t", "q", "dq"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    assert list(one.tau) == list(again.tau) == ["motor"]
    np.testing.assert_array_equal(one.tau["motor"], again.tau["motor"])
    assert (one.name, one.source, one.sha256) == (again.name, again.source, again.sha256)
    np.testing.assert_allclose(streamed.estimate.values, memory.estimate.values, rtol=1e-9, atol=1e-12)


def test_signs_rates_and_empty_channels_count_in_streaming(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    table = (
        {f"q{j + 1}": q[:, j] for j in range(6)} | {f"dq{j + 1}": 0 * t for j in range(6)} | {f"tau{j + 1}": -tau[:, j] for j in range(6)}
    )
    np.savez(tmp_path / "a.npz", **table)
    study = study_of(tmp_path / "a.npz", "motor")
    drive = replace(study.description.drive, torque_sign=(-1.0,))
    study = replace(study, description=replace(study.description, drive=drive), logs=replace(study.logs, rate_hz=1.0 / (t[1] - t[0])))
    (one,), (other,) = Session(study).recorded, StreamedSession.of(study, out=tmp_path / "out").stored
    again = other.read(0, len(other))
    np.testing.assert_array_equal(again.tau["motor"], tau)
    np.testing.assert_array_equal(one.t, again.t)
    assert one.dq is None
    assert again.dq is None
    assert [n for n in one.notes if "zero in every row" in n] == [n for n in again.notes if "zero in every row" in n]


def test_positions_a_turn_beyond_the_limits_are_moved_in_streaming_too(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    table = (
        {"t": t}
        | {f"q{j + 1}": q[:, j] + (2 * np.pi if j == 1 else 0.0) for j in range(6)}
        | {f"tau_m{j + 1}": tau[:, j] for j in range(6)}
    )
    np.savez(tmp_path / "a.npz", **table)
    study = study_of(tmp_path / "a.npz")
    (one,), (other,) = Session(study).recorded, StreamedSession.of(study, out=tmp_path / "out").stored
    assert one.q is not None
    np.testing.assert_allclose(other.arrays["q"][0 : len(other)], one.q, atol=1e-12)
    assert np.ptp([one.q[:, 1].mean(), q[:, 1].mean()]) < 1e-6
    assert any("unwrapped" in n for n in other.notes)


def test_what_is_read_whole_says_so(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    np.savez_compressed(tmp_path / "a.npz", t=t, q=q, tau=tau)
    with pytest.raises(UnsupportedError, match="cannot be streamed"):
        StreamedSession.of(study_of(tmp_path / "a.npz"), out=tmp_path / "out").stored  # noqa: B018


@pytest.fixture(scope="module")
def of_csv(tmp_path_factory: pytest.TempPathFactory) -> Array:
    """The fit of the recording as a CSV."""
    t, q, dq, tau = motion()
    names = ["t", *(f"{name}{j + 1}" for name in ("q", "dq", "tau_m") for j in range(6))]
    path = tmp_path_factory.mktemp("csv") / "log.csv"
    rows = np.column_stack([t, q, dq, tau]).tolist()
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows)]))
    return Session(study_of(path)).estimate.values


@pytest.mark.parametrize("kind", [*CHUNKED, *WHOLE])
def test_a_fit_from_each_format_is_that_of_the_csv(tmp_path: Path, of_csv: Array, kind: str) -> None:
    found = Session(study_of(written(tmp_path, kind), "motor" if kind in UNTOLD else None)).estimate
    # Stamps are rounded otherwise in each format: of a parameter that is next to nothing, a share of its deviation counts.
    np.testing.assert_array_less(np.abs(found.values - of_csv), 1e-9 * (np.abs(of_csv) + found.std))
