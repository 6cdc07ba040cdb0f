"""Logs of commands as they should not be: what is wrong with their clock, positions and commands is told, or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators import commanded
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.cli import main
from ident.diagnosis.drives import diagnose_drives
from ident.diagnosis.drives.candidates import DriveCandidate
from ident.diagnosis.drives.result import DriveFinding
from ident.diagnosis.drives.revision import Accepted, needed
from ident.diagnosis.drives.screening import Screened
from ident.diagnosis.drives.trials import Stage
from ident.drives import DriveLaw, fit_drives
from ident.drives.plant import DrivePlant
from ident.drives.search import fitted as fitted_by
from ident.drives.space import drive_logs
from ident.drives.starts import starts
from ident.errors import ConfigurationError, DataError
from ident.logs.log import Log, LogSet

pytestmark = needs_native
TRUTH = {"Ia": 0.012, "Fv": 0.1, "Fc": 0.15, "offset": 0.0, "kp": 25.0, "kd": 0.8, "delay": 0.006}
GAINS = {"kp": 25.0, "kd": 0.8}


@pytest.fixture(scope="module")
def robot() -> ident.Robot:
    return ident.Robot.from_urdf(PENDULUM)


@pytest.fixture(scope="module")
def log(robot: ident.Robot) -> Log:
    return commanded_log(robot, TRUTH, seed=3, rate=200, before=1.0)


def fitted(log: Log, robot: ident.Robot, **more: object):
    model = robot.rigid_body()
    for effect in ("rotor_inertia", "viscous", "coulomb"):
        model = model + ident.make_effect(effect)
    return fit_drives(LogSet((log,)), model, DriveLaw.of(robot, **{**GAINS, **more}))


def written(log: Log, path: Path, names: tuple[str, str], factor: float = 1.0) -> Path:
    rows = np.stack([log.t, log.q[:, 0], log.extra["q_cmd1"]], axis=1) * [1.0, factor, factor]
    path.write_text("\n".join([",".join(("t", *names)), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n")
    return path


def study(folder: Path, robot: ident.Robot, log: str, more: str = "", after: str = "") -> str:
    (folder / "r.urdf").write_text(PENDULUM)
    file = folder / "study.toml"
    file.write_text(
        f'[robot]\nurdf = "r.urdf"\n[drive]\nlaw = "pd_position"\nkp = 25.0\nkd = 0.8\n{more}\n[logs]\nfit = ["{log}"]\n{after}\n'
    )
    return str(file)


def test_milliseconds_taken_for_seconds_are_refused(log: Log, robot: ident.Robot) -> None:
    with pytest.raises(DataError, match="t_ms"):
        fitted(replace(log, t=1e3 * log.t), robot)


def test_a_column_of_an_encoder_that_is_dead_is_named(robot: ident.Robot, log: Log) -> None:
    leg = ident.Robot.from_urdf(LEG)
    both = commanded_log(leg, {**TRUTH, "kp": [25.0, 20.0]}, seed=3, rate=100, seconds=3.0, before=1.0)
    q = both.q.copy()
    q[:, 1] = 0.1
    fit = fitted(replace(both, q=q), leg, kp=[25.0, 20.0])
    assert any(leg.joint_names[1] in text and "never changes" in text for text in fit.warnings)
    assert not any(" inf " in text for text in fit.warnings)


def test_degrees_that_no_name_tells_are_noticed(log: Log, robot: ident.Robot) -> None:
    degrees = replace(log, q=np.degrees(log.q), extra={"q_cmd1": np.degrees(log.extra["q_cmd1"])})
    assert any("degrees" in text for text in fitted(degrees, robot).warnings)
    assert not any("degrees" in text for text in fitted(log, robot).warnings)


def test_a_wrong_reading_is_said_to_be_why_nothing_seems_to_move(log: Log, robot: ident.Robot) -> None:
    q = 0.05 * log.q
    q[500] += 30.0
    with pytest.raises(DataError, match=f"{float(log.t[500]):g} s"):
        fitted(replace(log, q=q), robot)


def test_a_gap_is_told_as_one(log: Log, robot: ident.Robot) -> None:
    kept = np.ones(len(log.t), bool)
    kept[400:500] = False
    short = replace(log, t=log.t[kept], q=log.q[kept], extra={"q_cmd1": log.extra["q_cmd1"][kept]})
    told = [text for text in fitted(short, robot).warnings if "times the usual error" in text]
    assert told
    assert all("gap" in text and "stiction" not in text for text in told)


@pytest.mark.parametrize("rate", [47.0, 60.0])
def test_the_interval_of_a_delay_holds_what_the_rows_do_not_tell(rate: float, robot: ident.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands of another clock than the rows': each is logged up to a row late."""
    plain = commanded.command

    def slow(seed: int, seconds: float, dense: float, n: int, rest: float = 0.5) -> np.ndarray:
        at = np.arange(round(seconds * dense)) / dense
        return plain(seed, seconds, dense, n, rest)[(np.floor(at * rate + 1e-9) / rate * dense).astype(int)]

    monkeypatch.setattr(commanded, "command", slow)
    dense = commanded_log(robot, TRUTH, seed=5, rate=2000, seconds=6.0, before=1.0)
    rows = slice(7, None, 10)
    log = Log("run", t=dense.t[rows] - dense.t[7], q=dense.q[rows], extra={"q_cmd1": dense.extra["q_cmd1"][rows]})
    fit = fitted(log, robot)
    ((_, low, high),) = fit.delay_interval().values()
    assert low < TRUTH["delay"] < high
    assert high - low > 0.005
    assert any("commands change every" in text for text in fit.warnings)


def test_commands_of_a_slower_loop_that_logs_itself_keep_their_instants(robot: ident.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = commanded.command

    def slow(seed: int, seconds: float, rate: float, n: int, rest: float = 0.5) -> np.ndarray:
        return np.repeat(plain(seed, seconds, rate, n, rest)[::4], 4, axis=0)[: round(seconds * rate)]

    monkeypatch.setattr(commanded, "command", slow)
    fit = fitted(commanded_log(robot, TRUTH, seed=5, rate=200, seconds=6.0, before=1.0), robot)
    ((_, low, high),) = fit.delay_interval().values()
    assert low < TRUTH["delay"] < high
    assert high - low < 0.001
    assert not any("commands change every" in text for text in fit.warnings)


def test_columns_of_commands_are_mapped(log: Log, robot: ident.Robot, tmp_path: Path) -> None:
    file = written(log, tmp_path / "a.csv", ("joint1_pos_deg", "goal (deg)"), float(np.degrees(1.0)))
    (read,) = ident.read_logs(file, robot, {"q_cmd1_deg": "goal (deg)"})
    assert fitted(read, robot).fit_rms[0] < 1e-3
    with pytest.raises(ConfigurationError, match="aim"):
        ident.read_logs(file, robot, {"q_cmd1_deg": "aim"})


def test_a_table_of_constants_for_no_log_is_refused(
    log: Log, robot: ident.Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(log, tmp_path / "soft.csv", ("q1", "q_cmd1"))
    file = study(tmp_path, robot, "soft.csv", after='[drive.by_log."stif_*"]\nkp = 20.0')
    assert main(["check", file]) == 2
    assert "stif_*" in capsys.readouterr().err
    file = study(tmp_path, robot, "soft.csv", after='[drive.by_log."sof*"]\nkp = 20.0')
    assert main(["check", file]) == 0


def test_springs_that_stand_in_for_gravity_end_a_diagnosis(robot: ident.Robot) -> None:
    """An offset that a spring's own torque at zero replaces may be found before it: what goes with it has to begin at nothing."""
    leg, leaning = ident.Robot.from_urdf(LEG), ident.Robot.from_urdf(LEG, gravity=(2.0, 0.0, -9.6))
    tilted = commanded_log(leaning, {**TRUTH, "kp": [25.0, 20.0]}, seed=3, rate=100, seconds=5.0, before=1.0)
    model = leg.rigid_body()
    for effect in ("rotor_inertia", "viscous", "coulomb"):
        model = model + ident.make_effect(effect)
    found = diagnose_drives(LogSet((tilted,)), model, DriveLaw.of(leg, kp=[25.0, 20.0], kd=0.8))
    assert found.findings
    assert found.verdict != "clean"


def test_an_offset_beside_a_spring_may_go(robot: ident.Robot, log: Log) -> None:
    """A spring has a torque at zero of its own where no offset stands for it: it begins at nothing where the offset goes."""
    model = robot.rigid_body()
    for effect in ("rotor_inertia", "viscous", "coulomb"):
        model = model + ident.make_effect(effect)
    law = DriveLaw.of(robot, **GAINS)
    declared = DrivePlant(model, law, drive_logs(LogSet((log,)), robot, law))
    offset, spring = DriveCandidate("offset", "offset"), DriveCandidate("linear_spring", "spring")
    plant = spring.added_to(offset.added_to(declared, [0]), [0])
    at, sizes = starts(plant)
    told = [DriveFinding(one.name, (), (), None, 0.5, 1.0, ()) for one in (offset, spring)]
    accepted = [Accepted(Screened(one, (0,), np.zeros(1), 0.5), text) for one, text in zip((offset, spring), told, strict=True)]
    kept, after = needed(declared, Stage(plant, fitted_by(plant, at, sizes), sizes), accepted)
    assert kept == []
    assert [u.name for u in after.plant.unknowns] == [u.name for u in declared.unknowns]
