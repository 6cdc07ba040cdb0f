"""Messages of errors: one text for people, whatever the input quotes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ident
from ident.errors import ConfigurationError, DataError
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


def test_a_model_without_parameters_has_no_covariance() -> None:
    noise = NoiseModel(np.array([[1.0, -0.5]]), np.eye(1), np.ones(1), np.ones(1))
    rows = [Rows(np.zeros((9, 1, 0)), np.zeros((9, 1)), np.ones((9, 1), bool), slice(0, 9), 0)]
    for residual in (None, np.ones((9, 1))):
        assert noise_gram(noise, rows, np.ones(1), residual).shape == (0, 0)
