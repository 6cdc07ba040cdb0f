"""Completion as a shell does it: bash itself is asked what it would offer."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable

import pytest
from command_line import Ran

from ident.commands import COMMANDS
from ident.estimators import estimator_types


@pytest.fixture
def offered(ident: Callable[..., Ran], tmp_path) -> Callable[..., set[str]]:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash")
    (tmp_path / "c.bash").write_text(ident("completion", "bash").out)
    (tmp_path / "train.csv").touch()

    def ask(*words: str) -> set[str]:
        script = f'source c.bash; COMP_WORDS=("$@"); COMP_CWORD={len(words) - 1}; _ident; printf "%s\\n" "${{COMPREPLY[@]}}"'
        done = subprocess.run([bash, "-c", script, "bash", *words], cwd=tmp_path, capture_output=True, text=True, check=True)
        assert not done.stderr
        return set(done.stdout.split())

    return ask


def test_commands_flags_names_and_files(offered):
    assert offered("ident", "") == set(COMMANDS)
    assert offered("ident", "mo") == {"monitor"}
    assert offered("ident", "fit", "--val") == {"--validate"}
    assert offered("ident", "fit", "--method", "") == set(estimator_types())
    assert "stribeck" in offered("ident", "fit", "--effects", "str")
    assert offered("ident", "excite", "--family", "") == {"fourier", "bspline"}
    assert offered("ident", "fit", "tra") == {"train.csv"}


def test_every_shell_has_every_flag(ident):
    from ident.cli import parsers

    for shell in ("bash", "zsh", "fish"):
        script = ident("completion", shell).out
        for name, parser in parsers().items():
            assert name in script
            for action in parser._actions:
                for option in action.option_strings:
                    assert (option if shell != "fish" else f" {'-l ' if option.startswith('--') else '-s '}{option.lstrip('-')}") in script


def test_another_shell_is_refused(ident):
    assert ident("completion", "csh").code == 2
