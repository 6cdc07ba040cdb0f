"""Fixed seeds of the fuzzer: whatever a file holds, it is read, or refused in one sentence; readings of one file do not differ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ident

from . import seeds
from .kills import state
from .kinds import KINDS, Kind
from .outcomes import Difference, tried
from .run import fuzz, made

COUNTS = {"logs": 120, "compressed": 120, "binary": 150, "urdf": 100, "toml": 80, "json": 60, "commands": 60}


def told(found) -> str:
    """The faults, for the message of a failed test."""
    return "\n".join(f"{o.kind} at {o.where}, seed {seed}: {o.text}" for _, o, _, seed in found.faults.values())


@pytest.mark.parametrize("name", [*KINDS])
def test_changed_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    found = fuzz(KINDS[name], tmp_path, 0, COUNTS[name])
    assert not found.faults, told(found)
    assert found.kinds["done"] >= 0.05 * found.total  # the changes are not all of a kind that any reader would refuse
    assert found.kinds["refused"] >= 0.1 * found.total


def test_no_variance_is_negative_where_few_rows_are_left() -> None:
    """Found by the fuzzer: a joint without torque for half the log, of which as many rows are left as it has parameters."""
    log = seeds.log_set()[0]
    (side,) = log.tau
    torque = log.tau[side].copy()
    torque[45:125, 1] = np.nan
    kept = ident.LogSet((replace(log, tau={side: torque}),))
    estimate = ident.fit(kept, seeds.robot(), model=[ident.make_effect("viscous")], held=0)
    assert np.all(np.diag(estimate.covariance) > 0.0)
    assert np.linalg.eigvalsh(estimate.covariance)[0] > -1e-9 * np.abs(estimate.covariance).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", [*KINDS])
def test_many_changed_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    found = fuzz(KINDS[name], tmp_path, 10_000, 10 * COUNTS[name])
    assert not found.faults, told(found)


@pytest.mark.parametrize("name", [*KINDS])
def test_the_files_that_are_changed_are_right(name: str, tmp_path: Path) -> None:
    kind = Kind(KINDS[name].name, KINDS[name].sources, KINDS[name].change, KINDS[name].use)
    for file, content in kind.sources().items():
        path = tmp_path / file
        path.write_bytes(unchanged(name, content))
        assert tried(kind.use, path).kind == "done", file


def unchanged(name: str, content: object) -> bytes:
    import json

    from ident._utils.toml import to_toml

    if name == "commands":
        content = content[1]  # type: ignore[index]
    if isinstance(content, bytes):
        return content
    return json.dumps(content).encode() if name == "json" else to_toml(content).encode()  # type: ignore[arg-type]


def test_an_input_is_made_again_from_its_seed() -> None:
    assert made(KINDS["logs"], 7) == made(KINDS["logs"], 7)
    assert made(KINDS["logs"], 7) != made(KINDS["logs"], 8)


def test_faults_are_found(tmp_path: Path) -> None:
    """The harness itself: a traceback, a hang, a difference and a refusal are told apart."""
    import time

    import ident

    path = tmp_path / "x"

    def refused(_: Path) -> None:
        raise ident.DataError("no")

    def differs(_: Path) -> None:
        raise Difference("two readings")

    assert tried(lambda p: p, path).kind == "done"
    assert tried(refused, path).kind == "refused"
    assert tried(differs, path).kind == "difference"
    assert tried(lambda _: 1 / 0, path).kind == "traceback"
    assert tried(lambda _: time.sleep(5), path, seconds=0.05).kind == "hang"
    assert seeds.robot().n == 2


def test_unfinished_work_is_no_result_and_is_removed(tmp_path: Path) -> None:
    """A folder that was being staged when its process was killed, with what it held."""
    import subprocess
    import sys

    from ident._utils.files import remove_all_leftovers

    (tmp_path / "fit.json").write_text("{}")
    code = (
        "import os, sys; from pathlib import Path; from ident._utils.files import staged\n"
        "with staged(Path(sys.argv[1]) / 'checkpoint') as scratch: (scratch / 'key.json').write_text('{}'); os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False, cwd=Path(__file__).parents[2]).returncode == -9
    (left,) = tmp_path.glob(".checkpoint*")
    assert (left / "key.json").exists()
    assert [*state(tmp_path)] == ["fit.json"]
    remove_all_leftovers(tmp_path)
    assert not left.exists()
