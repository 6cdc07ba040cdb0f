"""A stretch of a log that no model explains, and what is sent and does not arrive: neither bends what the rest of the log says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import ident
from benchmarks.actuators.commanded import PENDULUM, commanded_log
from benchmarks.actuators.servos import URDF, recorded, servo
from ident.diagnosis.drives import diagnose_drives
from ident.drives import DriveLaw, DriveLog, fit_drives
from ident.drives.plant import DrivePlant
from ident.drives.search import fitted
from ident.drives.sizes import doubtful_sizes
from ident.drives.space import drive_logs
from ident.drives.starts import starts
from ident.drives.stretches import beyond, steadied, unexplained
from ident.drives.unknowns import Unknown
from ident.logs.log import LogSet
from ident.regressor.kernel_choice import kernel

EFFECTS = ("rotor_inertia", "viscous", "coulomb", "offset")
SEEDS = [700, 701, 702]
TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "offset": 0.1, "kp": 25.0, "kd": 0.8, "delay": 0.006}
SHARE = 0.4


def model_of(robot):
    model = robot.rigid_body()
    for name in EFFECTS:
        model = model + ident.make_effect(name)
    return model


def logs_of(stuck):
    servos = [servo("clean", seed) for seed in SEEDS]
    t, q, sent = recorded(servos, SEEDS, stuck)
    return [(one, ident.Log("run", t=t, q=q[:, [k]], extra={"q_cmd1": sent[:, k]})) for k, one in enumerate(servos)]


@pytest.fixture(scope="module")
def stuck():
    """Servos that stick from 2.0 to 2.5 s."""
    return logs_of((2.0, 2.5))


def search(robot, log, **law):
    law = DriveLaw.of(robot, **law)
    plant = DrivePlant(model_of(robot), law, drive_logs(LogSet((log,)), robot, law))
    at, sizes = starts(plant)
    return plant, fitted(plant, at, sizes), sizes


def test_a_joint_that_sticks_for_a_while_does_not_bend_the_rest(stuck):
    robot = ident.Robot.from_urdf(URDF)
    off = []
    for one, log in stuck:
        plant, plain, sizes = search(robot, log, kp="identify", kd=one.kd)
        kp, dry = (next(i for i, u in enumerate(plant.unknowns) if u.place == place) for place in ("kp", "dry"))
        steady = steadied(plant, plain, sizes)
        assert steady.values[kp] == pytest.approx(one.kp, rel=0.02)
        assert steady.values[dry] == pytest.approx(one.Fc, rel=0.08)
        off.append(abs(plain.values[dry] / one.Fc - 1.0))
    assert min(off) > 0.1


def test_the_stretch_is_told(stuck):
    robot = ident.Robot.from_urdf(URDF)
    one, log = stuck[0]
    fit = fit_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, kp=one.kp, kd=one.kd))
    assert any("joint1, 2 to" in text and "times the usual error" in text for text in fit.warnings)


def test_a_diagnosis_does_not_name_what_a_stretch_looks_like(stuck):
    """Nothing is missing but what happened for half a second, which is told."""
    robot = ident.Robot.from_urdf(URDF)
    for one, log in stuck:
        found = diagnose_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, **one.declared))
        assert not found.findings
        assert any("joint1, 2 to" in text for text in found.warnings)
        assert "times the usual error" in found.summary()
        assert found.to_dict()["warnings"] == list(found.warnings)


def test_a_clean_log_keeps_its_fit():
    robot = ident.Robot.from_urdf(URDF)
    for one, log in logs_of((0.0, 0.0)):
        plant, plain, sizes = search(robot, log, kp=one.kp, kd=one.kd)
        assert steadied(plant, plain, sizes) is plain
        assert not unexplained(plant, plain)


def test_a_stretch_is_judged_by_a_fit_that_it_does_not_bend():
    """Joints with 1 N m more of dry friction for half a second: fits to all of it are bent so far that nothing stands out of them."""
    robot = ident.Robot.from_urdf(URDF)
    for one, log in logs_of((3.2, 3.7))[:2]:
        plant, plain, sizes = search(robot, log, kp="identify", kd=one.kd)
        (told,) = unexplained(plant, steadied(plant, plain, sizes))
        assert told.start == pytest.approx(3.0)
        assert told.times > 20.0


def test_a_model_that_is_not_refined_keeps_its_whole_log():
    """Gear friction that is not declared: the error is several times larger where the link is heavy on the gear than where it hangs."""
    robot = ident.Robot.from_urdf(URDF)
    servos = [servo("load_dependent_friction", seed) for seed in SEEDS[:2]]
    t, q, sent = recorded(servos, SEEDS[:2])
    for k, one in enumerate(servos):
        log = ident.Log("run", t=t, q=q[:, [k]], extra={"q_cmd1": sent[:, k]})
        plant, plain, sizes = search(robot, log, kp=one.kp, kd=one.kd)
        assert steadied(plant, plain, sizes) is plain


def test_a_joint_that_mostly_rests_keeps_the_stretches_in_which_it_moves():
    """Steps with a command between them that dry friction holds: only where the joint moves can a model that is not refined err."""
    robot = ident.Robot.from_urdf(URDF)
    t = np.arange(0.0, 10.0, 1.0 / 200.0)
    sent = 0.02 * np.sin(12.0 * t) + 0.4 * (np.sin(np.pi * (t - 0.5) / 1.25) > 0.0)
    law = {"kp": 25.0, "kd": 0.8, "delay_s": 0.006}
    still = ident.Log("run", t=t, q=np.zeros((len(t), 1)), extra={"q_cmd1": sent})
    whole = model_of(robot) + ident.make_effect("load_dependent_friction")
    plant = DrivePlant(whole, DriveLaw.of(robot, **law), drive_logs(LogSet((still,)), robot, DriveLaw.of(robot, **law)))
    truth = {"armature": 0.012, "viscous": 0.08, "dry": 1.0, "offset": 0.0, "load": 0.15}
    (q,) = plant.positions(np.array([truth[u.place] for u in plant.unknowns]))
    rng = np.random.default_rng(5)
    log = ident.Log("run", t=t, q=q[0] + 5e-4 * rng.standard_normal(q[0].shape), extra=still.extra)
    plant, plain, sizes = search(robot, log, **law)
    assert steadied(plant, plain, sizes) is plain


#: Errors of stretches: of a log in which one is unlike the others, and of one whose model errs by much here and by little there.
APART = np.array([3.6, 0.9, 0.9, 1.1, 0.8, 1.0, 1.3, 1.2])
SPREAD = np.array([0.4, 0.2, 0.5, 5.0, 4.2, 1.8, 1.2, 1.0, 0.5])


def test_the_others_spread_says_what_is_beyond_them():
    """By the quantile of one more observation of a normal distribution, which scipy has by another way."""
    assert list(APART > beyond(APART, 0.01)) == [True] + 7 * [False]
    assert not np.any(beyond(SPREAD, 0.01) < SPREAD)
    rest = np.log(APART[1:])
    limit = stats.t(df=6, loc=rest.mean(), scale=rest.std(ddof=1) * np.sqrt(8 / 7)).ppf(1.0 - 0.01 / 8)
    assert beyond(APART, 0.01) == pytest.approx(np.exp(limit))
    two = np.append(APART, 3.4)
    assert list(two > beyond(two, 0.01)) == [True] + 7 * [False] + [True]


def test_errors_of_one_kind_are_seldom_told():
    rng = np.random.default_rng(4)
    for n in (6, 12, 40):
        sets = np.exp(0.5 * rng.standard_normal((1000, n)))
        assert np.mean([np.any(one > beyond(one, 0.01)) for one in sets]) < 0.03


@pytest.fixture(scope="module")
def partly_sent():
    """A log whose feed-forward reaches the drive by four tenths: under known kp, a torque is a shift of the position command."""
    if not kernel().compiled:
        pytest.skip("the log is simulated by compiled code")
    robot = ident.Robot.from_urdf(PENDULUM)
    log = commanded_log(robot, TRUTH, seed=3)
    forward = 0.6 * np.sin(2.0 * np.pi * 1.3 * log.t) * (log.t > 0.5)
    extra = {"q_cmd1": log.extra["q_cmd1"] - SHARE * forward / TRUTH["kp"], "tau_ff1": forward}
    return robot, ident.Log("run", t=log.t, q=log.q, extra=extra)


def test_the_share_of_a_feed_forward_that_arrives(partly_sent):
    robot, log = partly_sent
    fit = fit_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, kp=25.0, kd=0.8, feed_forward="identify"))
    assert fit.value("f_joint1") == pytest.approx(SHARE, abs=0.02)
    known = fit_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, kp=25.0, kd=0.8, by_log={"run": {"feed_forward": SHARE}}))
    assert known.fit_rms[0] == pytest.approx(5e-4, rel=0.1)


def test_a_feed_forward_that_was_not_sent_as_logged_is_named(partly_sent):
    robot, log = partly_sent
    found = diagnose_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=TRUTH["delay"]))
    assert [f.effect for f in found.findings] == ["feed_forward"]
    assert found.findings[0].declared == (1.0,)
    assert found.findings[0].values[0][1] == pytest.approx(SHARE, abs=0.03)


def test_noise_on_a_joint_at_rest_is_no_speed():
    robot = ident.Robot.from_urdf(PENDULUM)
    law = DriveLaw.of(robot, kp=1.0)
    rng = np.random.default_rng(12)
    t = np.arange(100) * 0.005

    def starts_of(motion):
        logs = (ident.Log("run", t=t, q=(motion + 5e-4 * rng.standard_normal(100))[:, None], extra={"q_cmd1": t}) for _ in range(400))
        return [DriveLog.of(log, robot, law) for log in logs]

    still = starts_of(np.zeros(100))
    assert sum(log.start[0] != 0.0 for log in still) <= 1
    # Of 100 readings 96 say where it rests; one log in forty used to take the first six alone.
    assert np.std([log.origin[0] for log in still]) < 6e-5
    moving = starts_of(0.5 * t)
    assert np.mean([log.start[0] != 0.0 for log in moving]) > 0.9


def test_friction_that_has_pushed_another_to_zero_has_no_size():
    """By two unknowns of one joint: a minimum beyond a bound has no standard deviation; a loss of more than all is none of a gear."""
    named = [("Fc", "dry", 0.0), ("Fl", "load", 0.4)]
    unknowns = [Unknown(f"{symbol}_joint1", "1", place, 0) for symbol, place, _ in named]
    values = np.array([value for *_, value in named])
    apart, traded = np.diag([0.01, 0.0025]), np.array([[0.01, -0.0045], [-0.0045, 0.0025]])
    assert doubtful_sizes(unknowns, values, apart) == {}
    assert "Fc_joint1 was estimated as zero" in doubtful_sizes(unknowns, values, traded)[1]
    assert doubtful_sizes(unknowns, values + [0.3, 0.0], traded) == {}
    assert "physically impossible" in doubtful_sizes(unknowns, values + [0.3, 2.0], apart)[1]
