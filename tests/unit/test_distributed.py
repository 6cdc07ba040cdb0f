"""The streamed reduction on a Dask cluster: equal to the local one, failures named or skipped."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import analytic_log, write_csv

import ident
from ident.errors import DataError
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import nominal_values
from ident.streaming import StreamedSession
from ident.study.study import Study

distributed = pytest.importorskip("dask.distributed", reason="Dask is not installed (pip install ident[dask])")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as found,
    ):
        yield found


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    robot = ident.load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    values = nominal_values(model)
    return [write_csv(folder / f"run{i}.csv", analytic_log(model, values, i, seconds=20.0, noise=0.02)) for i in range(3)]


def test_equal_to_the_local_reduction(client: Any, logs: list[Path]) -> None:
    from ident.streaming.distributed import DaskWorkers

    study = Study.from_flags(robot="puma560", logs=logs)
    found = []
    for workers in (None, DaskWorkers(client)):
        session = StreamedSession.of(study, workers=workers)
        found.append(session.estimate)
        session.checkpoint.remove()
    local, remote = found
    assert np.linalg.norm(local.values - remote.values) <= 1e-12 * np.linalg.norm(local.values)
    assert np.linalg.norm(local.covariance - remote.covariance) <= 1e-12 * np.linalg.norm(local.covariance)
    assert local.warnings == remote.warnings


def test_a_corrupt_file_is_named_or_skipped_with_a_record(client: Any, logs: list[Path], tmp_path: Path) -> None:
    from ident.streaming.distributed import DaskWorkers

    bad = tmp_path / "corrupt.csv"
    bad.write_bytes(logs[0].read_bytes()[:40_000] + b"\n1,2,x,#\n")
    study = Study.from_flags(robot="puma560", logs=[*logs, bad])
    with pytest.raises(DataError, match=r"corrupt\.csv"):
        StreamedSession.of(study, workers=DaskWorkers(client)).stored  # noqa: B018
    session = StreamedSession.of(study, workers=DaskWorkers(client), skip_bad_files=True)
    assert len(session.stored) == 3
    assert any("corrupt.csv" in w for w in session.estimate.warnings)
    session.checkpoint.remove()


def test_a_failing_worker_is_named(client: Any) -> None:
    from ident.streaming.distributed import DaskWorkers

    with pytest.raises(DataError, match=r"runs/a\.csv.*RuntimeError"):
        list(DaskWorkers(client, retries=0).map(_fails, [_piece("runs/a.csv")]))


def _piece(path: str) -> Any:
    from types import SimpleNamespace

    return SimpleNamespace(path=path)


def _fails(piece: Any) -> None:
    raise RuntimeError("out of memory")
