"""A command that fails leaves nothing behind, and says what is wrong with its numbers."""

from __future__ import annotations

import pytest
from command_line import FRICTION

CONFIGURATION, DATA = 2, 3


@pytest.fixture
def short(arm, tmp_path):
    """The first rows of a log: too few for anything."""
    path = tmp_path / "short.csv"
    path.write_text("\n".join(arm.train.read_text().splitlines()[:40]) + "\n")
    return path


@pytest.mark.parametrize("stream", [(), ("--stream",)], ids=["whole", "streamed"])
@pytest.mark.parametrize("command", ["fit", "check", "validate"])
def test_no_folder_is_left(ident, arm, short, tmp_path, command, stream):
    out = tmp_path / "new" / "deep"
    ran = ident(command, "--urdf", arm.urdf, *FRICTION, "--log", short, "--quiet", *stream, "--out", out)
    assert ran.code == DATA
    assert not out.parent.exists()


def test_no_folder_is_left_by_others(ident, arm, saved_fit, short, tmp_path):
    out = ("--out", tmp_path / "new" / "deep")
    for command in (
        ("compare", saved_fit, saved_fit, "--log", short),
        ("monitor", "--fit", saved_fit, "--log", short),
        ("payload", "--fit", saved_fit, "--log", short),
        ("base", "--urdf", arm.urdf, "--principal", short),
        ("validate", "--fit", saved_fit, "--log", short),
    ):
        assert ident(*command, *out).code == DATA, command
        assert not (tmp_path / "new").exists(), command
    for command in (
        ("simulate", "--urdf", arm.urdf, "--effects", "nonsense"),
        ("excite", "--urdf", arm.urdf, "--effects", "nonsense"),
        ("export", saved_fit, tmp_path / "x.nonsense"),
        ("judge", saved_fit, "--repair", "nonsense"),
    ):
        assert ident(*command, *out).code == CONFIGURATION, command
        assert not (tmp_path / "new").exists(), command


def test_a_folder_that_was_there_stays(ident, arm, short, tmp_path):
    (tmp_path / "mine").mkdir()
    ran = ident("fit", "--urdf", arm.urdf, *FRICTION, "--log", short, "--quiet", "--stream", "--out", tmp_path / "mine")
    assert ran.code == DATA
    assert (tmp_path / "mine").is_dir()


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("excite", "--seconds", "0"), "positive"),
        (("excite", "--seconds", "0.01"), "fewer equations"),
        (("excite", "--starts", "0"), "1 or more"),
        (("simulate", "--seconds", "nan"), "positive"),
        (("simulate", "--rate", "-1"), "positive"),
        (("simulate", "--noise", "-1"), "positive"),
    ],
)
def test_numbers_that_cannot_be(ident, arm, tmp_path, monkeypatch, flags, said):
    monkeypatch.chdir(tmp_path)
    ran = ident(flags[0], "--urdf", arm.urdf, *flags[1:])
    assert ran.code == CONFIGURATION
    assert said in ran.err
    assert list(tmp_path.iterdir()) == []
