"""Messages of errors: one text for people, whatever the input quotes."""

from __future__ import annotations

import bz2
import gzip
import lzma
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import ident
from ident.errors import ConfigurationError, DataError
from ident.logs.readers.header import Header
from ident.logs.readers.tables import read_labels
from ident.signals.rows import Rows
from ident.statistics.noise import NoiseModel, noise_gram


def test_a_message_shows_what_is_no_character_and_cuts_what_is_no_name(tmp_path: Path) -> None:
    assert str(DataError("log a\x00b: damaged")) == "log a\\x00b: damaged"
    plain = "a message of usual words " * 20
    assert str(DataError(plain)) == plain
    name = "x" * 5000
    said = str(ConfigurationError(f"joint {name!r}: its child link is not declared."))
    assert len(said) < 300
    assert said.endswith("… its child link is not declared.")
    with pytest.raises(ConfigurationError) as caught:
        ident.Robot.from_urdf(tmp_path / "a\x00b.urdf")
    assert "\x00" not in str(caught.value)


@pytest.mark.parametrize("module", [gzip, bz2, lzma])
def test_a_packed_log_that_ends_too_early_is_damaged_whoever_reads_it(module: ModuleType, tmp_path: Path) -> None:
    """Also where a column of text is read before the numbers: joint names that tell which joint a row is of."""
    rng = np.random.default_rng(0)
    rows = "".join(f"{i / 100},joint{1 + i % 2},{x},{y}\n" for i, (x, y) in enumerate(rng.normal(size=(6000, 2))))
    whole = module.compress(("t,name,position,effort\n" + rows).encode())
    path, header = tmp_path / "log.csv", Header(("t", "name", "position", "effort"), 1, ",")
    for share in (0.5, 0.8, 0.95):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(DataError, match="the file is damaged"):
            read_labels(path, header, "name")


def test_a_model_without_parameters_has_no_covariance() -> None:
    noise = NoiseModel(np.array([[1.0, -0.5]]), np.eye(1), np.ones(1), np.ones(1))
    rows = [Rows(np.zeros((9, 1, 0)), np.zeros((9, 1)), np.ones((9, 1), bool), slice(0, 9), 0)]
    for residual in (None, np.ones((9, 1))):
        assert noise_gram(noise, rows, np.ones(1), residual).shape == (0, 0)


def test_a_setting_that_is_called_name_is_unknown_like_any_other(tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text('[robot]\nname = "scara"\n[estimator]\nname = "wls"\n')
    with pytest.raises(ConfigurationError, match="name"):
        ident.read_study(study).make_estimator()
