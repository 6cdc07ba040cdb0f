"""Makes docs/data/servo.urdf, servo.csv and servo_check.csv: a leg of two servo joints that holds position commands, with a known truth.
`python docs/tools/make_servo_log.py`; the simulation is that of the tests (benchmarks/actuators/commanded.py)."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import ident  # noqa: E402
from benchmarks.actuators.commanded import LEG, commanded_log  # noqa: E402

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "offset": 0.0, "kp": 25.0, "kd": 0.8, "delay": 0.006}


def main() -> None:
    """Write the three files."""
    data = ROOT / "docs/data"
    (data / "servo.urdf").write_text(LEG + "\n", encoding="utf-8")
    robot = ident.Robot.from_urdf(LEG)
    for seed, name in enumerate(("servo", "servo_check")):
        log = commanded_log(robot, TRUTH, seed=seed, seconds=6.0, name=name)
        log.to_frame().round(6).to_csv(data / f"{name}.csv", index=False)


if __name__ == "__main__":
    main()
