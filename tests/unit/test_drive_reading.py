"""Logs of commands as they come: exchanged columns, degrees, missing commands, full turns, and parts of one run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native
from scipy.signal import lfilter

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.drives import DriveLaw, DriveLog, fit_drives
from ident.drives.commands import commanded
from ident.drives.space import drive_logs
from ident.errors import DataError
from ident.logs.log import LogSet
from ident.logs.runs import whole_runs

TRUTH = {"Ia": [0.012, 0.01], "Fv": 0.1, "Fc": [0.3, 0.2], "kp": [25.0, 20.0], "kd": 0.8, "delay": 0.006}
#: An arm that turns about the vertical: all turns are alike to it.
TABLE = PENDULUM.replace('xyz="0 1 0"', 'xyz="0 0 1"').replace('<origin xyz="0 0 -0.2"/>', '<origin xyz="0.2 0 0"/>')

pytestmark = needs_native


@pytest.fixture(scope="module")
def leg() -> tuple[ident.Robot, DriveLaw, ident.Log]:
    robot = ident.Robot.from_urdf(LEG)
    log = commanded_log(robot, TRUTH, seed=1, seconds=8.0, before=1.0)
    return robot, DriveLaw.of(robot, kp=[25.0, 20.0], kd=0.8), log


def model(robot: ident.Robot) -> ident.Model:
    return robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()


@pytest.mark.parametrize("seed", range(4))
def test_commands_of_other_joints_are_refused(seed):
    """With their names; in their own order the same logs are taken, however softly the joints follow."""
    robot = ident.Robot.from_urdf(LEG)
    law = DriveLaw.of(robot, kp=[25.0, 20.0], kd=0.8)
    log = commanded_log(robot, TRUTH, seed=seed, before=1.0)
    assert drive_logs((log,), robot, law)
    other = {"q_cmd1": log.extra["q_cmd2"], "q_cmd2": log.extra["q_cmd1"]}
    with pytest.raises(DataError, match=r"hip follows q_cmd2 \(knee\), knee follows q_cmd1 \(hip\)"):
        drive_logs((replace(log, extra=other),), robot, law)


def test_degrees_beside_radians_are_refused(leg):
    robot, law, log = leg
    for wrong in (replace(log, q=np.rad2deg(log.q)), replace(log, extra={k: np.rad2deg(x) for k, x in log.extra.items()})):
        with pytest.raises(DataError, match=r"hip, knee"):
            drive_logs((wrong,), robot, law)


def test_missing_commands_are_told(leg):
    robot, law, log = leg
    some = log.extra["q_cmd1"].copy()
    some[200:230] = some[400] = np.nan
    seen = DriveLog.of(replace(log, extra={**log.extra, "q_cmd1": some}), robot, law)
    (note,) = seen.notes
    assert "q_cmd1 (joint hip)" in note
    assert "31 of 800" in note
    assert "30 of them" in note
    assert np.all(seen.q_cmd[200:230, 0] == log.extra["q_cmd1"][199])
    assert DriveLog.of(log, robot, law).notes == ()


@pytest.mark.parametrize("commands", ["on one turn", "that go on", "of another turn"])
def test_positions_and_commands_over_a_full_turn(commands):
    robot = ident.Robot.from_urdf(TABLE)
    plain = commanded_log(robot, {"Ia": 0.02, "Fv": 0.1, "Fc": 0.2, "kp": 20.0, "kd": 1.0, "delay": 0.006}, seed=2, before=1.0)
    law = DriveLaw.of(robot, kp=20.0, kd=1.0)
    sent = plain.extra["q_cmd1"] + np.pi
    sent = {"on one turn": np.angle(np.exp(1j * sent)), "that go on": sent, "of another turn": sent + 4.0 * np.pi}[commands]
    turned = replace(plain, q=np.angle(np.exp(1j * (plain.q + np.pi))), extra={"q_cmd1": sent})
    assert np.ptp(turned.q) > 6.0
    seen, straight = DriveLog.of(turned, robot, law), DriveLog.of(plain, robot, law)
    np.testing.assert_allclose(seen.q_cmd - seen.q, straight.q_cmd - straight.q, atol=1e-9)
    assert "joint1" in seen.notes[0]
    assert fit_drives(LogSet((turned,)), model(robot), law).value("Fc_joint1") == pytest.approx(0.2, rel=0.03)


@pytest.mark.parametrize("back", [6.0, 9.0])
def test_a_step_of_nearly_a_turn_is_one(back):
    """Commands that jump where the joint does not follow by leaving out the turn are as they were sent."""
    robot = ident.Robot.from_urdf(TABLE)
    t = np.arange(800) / 100.0
    sent = np.where((t > 3.0) & (t < back), 3.0, -3.0)
    q = -3.0 + 6.0 * (np.clip((t - 3.0) / 0.8, 0.0, 1.0) - np.clip((t - back) / 0.8, 0.0, 1.0))
    seen = DriveLog.of(ident.Log("run", t=t, q=q[:, None], extra={"q_cmd1": sent}), robot, DriveLaw.of(robot, kp=20.0))
    np.testing.assert_array_equal(seen.q_cmd[:, 0], sent)


@pytest.mark.parametrize(("hold", "slow"), [(2, 0.99), (25, 0.99), (10, 0.97)])
def test_wild_steps_stay(hold, slow):
    """Steps of up to nearly a turn, some of them taken back before the joint has come half of the way."""
    robot = ident.Robot.from_urdf(TABLE)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        sent = np.repeat(rng.uniform(-3.0, 3.0, 1000 // hold), hold)
        q = lfilter([1.0 - slow], [1.0, -slow], sent, zi=[slow * sent[0]])[0] + 5e-4 * rng.standard_normal(1000)
        log = ident.Log("run", t=np.arange(1000) / 100.0, q=q[:, None], extra={"q_cmd1": sent})
        np.testing.assert_allclose(DriveLog.of(log, robot, DriveLaw.of(robot, kp=20.0)).q_cmd[:, 0], sent, atol=1e-9)


def one_turn(angles: np.ndarray, begins: float = -np.pi) -> np.ndarray:
    return begins + np.mod(angles - begins, 2.0 * np.pi)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("begins", [(-np.pi, -np.pi), (0.0, 0.0), (-np.pi, 0.0), (None, -np.pi), (-np.pi, None)])
def test_staircases_over_a_full_turn(seed, begins):
    """Steps of up to a radian across the end of the turn: the jump of the command is then far from a full one. In each, the turn on which
    positions and commands are logged, None where they go on."""
    robot = ident.Robot.from_urdf(TABLE)
    rng = np.random.default_rng(seed)
    middle = next((begin for begin in begins[::-1] if begin is not None), 0.0)
    steps = middle + np.resize([-0.6, -0.5, 0.5, 0.6], 40) + rng.uniform(-0.1, 0.1, 40)
    sent = np.repeat(steps, 25)
    q = lfilter([0.1], [1.0, -0.9], sent, zi=[0.9 * sent[0]])[0] + 5e-4 * rng.standard_normal(1000)
    logged = [x if begin is None else one_turn(x, begin) for x, begin in zip((q, sent), begins, strict=True)]
    log = ident.Log("run", t=np.arange(1000) / 100.0, q=logged[0][:, None], extra={"q_cmd1": logged[1]})
    seen = DriveLog.of(log, robot, DriveLaw.of(robot, kp=20.0))
    np.testing.assert_allclose(seen.q_cmd[:, 0] - seen.q[:, 0], sent - q, atol=1e-9)


def test_supplies_are_no_velocities(tmp_path, leg):
    """`supply1_V`: a voltage, whose unit is also a symbol of velocity."""
    robot = leg[0]
    t = np.arange(300) / 100.0
    columns = {"time_s": t, "q1_rad": np.sin(t), "q2_rad": np.cos(t), "q_cmd1_rad": np.sin(t), "q_cmd2_rad": np.cos(t)}
    columns |= {"supply1_V": 12.0 - np.sin(t) ** 2, "supply2_V": 11.0 - np.sin(t) ** 2}
    path = tmp_path / "a.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    log = ident.read_logs(path, robot).logs[0]
    assert log.notes == ()
    np.testing.assert_allclose(commanded(log.extra, robot)["supply"], np.column_stack([columns["supply1_V"], columns["supply2_V"]]))


def test_one_supply_for_all_joints(leg):
    robot, _, log = leg
    law = DriveLaw.of(robot, "pwm", kp=4.0)
    volts = 12.0 - 0.1 * np.arange(len(log)) / len(log)
    seen = DriveLog.of(replace(log, extra={**log.extra, "supply_mV": 1e3 * volts}), robot, law)
    np.testing.assert_allclose(seen.supply, np.column_stack([volts, volts]))
    seen = DriveLog.of(replace(log, extra={**log.extra, "supply_V": volts, "supply2_V": volts - 1.0}), robot, law)
    np.testing.assert_allclose(seen.supply, np.column_stack([volts, volts - 1.0]))


@pytest.mark.parametrize(
    ("kind", "given", "held", "column"),
    [("pwm", {"kp": 4.0}, {"q_cmd1": 0.0}, "supply1_V"), ("pd_position", {"kp": 4.0}, {}, "q_cmd1"), ("voltage", {}, {}, "voltage1_V")],
)
def test_columns_that_are_missing_are_named(kind, given, held, column):
    """One of a single joint, first and last of several."""
    for urdf, said in ((PENDULUM, f"column {column}"), (LEG, f"columns {column} … {column.replace('1', '2')}")):
        robot = ident.Robot.from_urdf(urdf)
        t = np.arange(100) / 100.0
        extra = {f"{what[:-1]}{j + 1}": np.full(100, x) for what, x in held.items() for j in range(robot.n)}
        with pytest.raises(DataError, match=f", {said}[,.]"):
            DriveLog.of(ident.Log("run", t=t, q=np.zeros((100, robot.n)), extra=extra), robot, DriveLaw.of(robot, kind, **given))


@pytest.mark.parametrize(("by", "share"), [("fraction", 0.25), ("blocks", 0.4)])
def test_a_later_part_goes_on_from_the_earlier(leg, by, share):
    """Its error is that of the noise: commands from before it, and its speed, are those of the run."""
    robot, law, log = leg
    train, held = LogSet((log,)).split(by=by, held=share)
    fit = fit_drives(LogSet((log,)), model(robot), law)
    np.testing.assert_allclose(fit.with_heldout(held, train).heldout_rms, 5e-4, rtol=0.1)
    alone = fit.with_heldout(held).heldout_rms
    assert np.all(alone > 4e-4)
    assert set(fit.replay_after(held, train)) == {part.name for part in held}
    if by == "fraction":
        assert fit_drives(train, model(robot), law, held=held).heldout_rms == pytest.approx(5e-4, rel=0.1)
        assert np.max(alone) > 2e-3


def test_runs_are_put_together_again(leg):
    *_, log = leg
    train, held = LogSet((log, replace(log, name="other"))).split(by="blocks", held=0.25)
    for whole, rows in whole_runs(held, train):
        for part in held:
            if part.name in rows:
                np.testing.assert_array_equal(whole.q[rows[part.name]], part.q)
                np.testing.assert_array_equal(whole.extra["q_cmd2"][rows[part.name]], part.extra["q_cmd2"])
    assert {whole.name for whole, _ in whole_runs(held, train)} == {log.name, "other"}
    assert sum(len(whole) for whole, _ in whole_runs(held, train)) == 2 * len(log)
    # A part that is missing between two leaves them apart.
    apart = whole_runs(held.logs[:1], [part for part in train if part.t[0] > held.logs[0].t[-1] + 0.5])
    assert [len(whole) for whole, _ in apart] == [len(held.logs[0])]
