"""What is loud beside a quiet drive: scores of all kinds and joints are alike there, and what is missing passes for noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.diagnosis.arms import arm
from benchmarks.diagnosis.feedback.suite import Setup, possible, simulate_setup
from benchmarks.diagnosis.generate import Case, record_of
from benchmarks.diagnosis.score import run

#: Parts of a case: effect, joint, size.
STEP = ("offset_step", 0, 1.0)
LOUD_STEP, SOFT = ("offset_step", 0, 1.5), ("presliding", 1, 1.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setup", "seed", "parts"), [(99032, 99032831, (STEP,)), (89465, 89465021, (LOUD_STEP, SOFT))], ids=["step", "both"]
)
def test_all_that_is_missing_is_named(setup: int, seed: int, parts: tuple[tuple[str, int, float], ...], tmp_path: Path) -> None:
    """A direct drive with little noise whose torque steps; and whose other joint's friction builds up, too."""
    drawn = Setup.drawn(setup)
    ((case, faults),) = possible(arm(drawn.arm), Case(drawn.arm, parts, seed, "pair" if len(parts) > 1 else "single", drawn.seconds))
    (log,) = simulate_setup(drawn, [case], [faults])
    np.savez(tmp_path / f"{case.id}.npz", **log)  # type: ignore[arg-type]
    found = run(tmp_path, record_of(case, faults))
    assert {f["effect"] for f in found["findings"]} == {name for name, _, _ in parts}
    assert all(f["confidence"] > 0.5 for f in found["findings"])
