"""Shared test helpers: real measured logs are found, or the test is skipped with a reason."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from command_line import arm, ident, saved_fit  # noqa: F401 - fixtures of tests/cli

# One BLAS thread each: xdist's workers begin with this environment, and two that share two cores wait for each other else.
for _key in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_key, "1")


def shared_data() -> Path:
    """The folder of real logs: `IDENT_DATA`, or `../shared/data` beside the checkout. Skips where it is absent."""
    named = os.environ.get("IDENT_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"real logs are not here ({folder}); set IDENT_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """`shared_data()` as a fixture."""
    return shared_data()
