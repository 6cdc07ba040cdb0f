"""Drive laws: what is read, what is simulated, what is identified of a known truth, and what is said of what cannot be."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators import coverage, servos
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.drives import DriveFit, DriveLaw, DriveLog, fit_drives, simulate
from ident.drives.descent import SimulatedSearch
from ident.drives.determined import Standing
from ident.drives.plant import DrivePlant
from ident.drives.starts import starts
from ident.drives.torque import with_torque
from ident.drives.unknowns import CONSTANTS, unknowns
from ident.logs.log import LogSet

pytestmark = needs_native  # which plays the drives of the logs

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "offset": 0.1, "kp": 25.0, "kd": 0.8, "delay": 0.006}


@pytest.fixture(scope="module")
def robot():
    return ident.Robot.from_urdf(PENDULUM)


def model_of(robot):
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous()
    return model + ident.friction.Coulomb() + ident.make_effect("offset")


def verdicts(fit: DriveFit) -> dict[str, Standing]:
    return dict(zip(fit.names, fit.determination.verdicts, strict=True))


@pytest.fixture(scope="module")
def known(robot):
    """Gains known: fitted to one log, held against another."""
    logs = [commanded_log(robot, TRUTH, seed=seed, name=f"run{seed}") for seed in (0, 1)]
    law = DriveLaw.of(robot, kp=25.0, kd=0.8)
    return fit_drives(LogSet(tuple(logs[:1])), model_of(robot), law, held=LogSet(tuple(logs[1:])))


def test_known_gains_give_the_truth(known):
    for name, true in (("Ia_joint1", 0.012), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15), ("offset_joint1", 0.1), ("delay", 0.006)):
        i = known.names.index(name)
        std = np.sqrt(known.covariance[i, i])
        assert abs(known.values[i] - true) < 3.5 * std + 0.002 * true, name
        assert verdicts(known)[name] == Standing.DETERMINED, name
    assert known.value("Ia_joint1") == pytest.approx(0.012, rel=0.05)
    assert known.value("delay") == pytest.approx(0.006, abs=0.3 * 0.01)


def test_error_on_held_out_logs_is_the_noise(known):
    assert known.heldout_rms[0] == pytest.approx(5e-4, rel=0.15)


def test_viscous_friction_and_kd_are_one_number_while_no_velocity_is_commanded(robot):
    logs = LogSet((commanded_log(robot, TRUTH, seed=2),))
    fit = fit_drives(logs, model_of(robot), DriveLaw.of(robot, kp=25.0, kd="identify"))
    shown = verdicts(fit)
    assert shown["Fv_joint1"] == shown["kd_joint1"] == Standing.CONFOUNDED
    (found,) = fit.determination.combinations
    assert found.expression == "Fv_joint1 + kd_joint1"
    assert abs(found.value - 0.88) < 3.5 * found.std + 0.002
    assert "dq_cmd" in found.separated_by
    entries = {p["name"]: p for p in fit.to_dict()["parameters"]}
    assert "value" not in entries["kd_joint1"]
    assert "value" not in entries["Fv_joint1"]
    assert "value" in entries["Ia_joint1"]
    assert not [line for line in fit.summary().splitlines() if line.split()[:1] == ["kd_joint1"]]


def test_a_moving_velocity_command_separates_them(robot):
    logs = LogSet((commanded_log(robot, TRUTH, seed=2, speed_command=True),))
    fit = fit_drives(logs, model_of(robot), DriveLaw.of(robot, kp="identify", kd="identify"))
    assert verdicts(fit)["kd_joint1"] == Standing.DETERMINED
    assert fit.value("kd_joint1") == pytest.approx(0.8, rel=0.05)
    assert fit.value("kp_joint1") == pytest.approx(25.0, rel=0.03)


def test_gains_that_have_the_scale_of_the_urdf_say_so(robot):
    logs = LogSet((commanded_log(robot, TRUTH, seed=2),))
    for kp, links, told in (("identify", "known", True), (25.0, "known", False), ("identify", "identify", False)):
        fit = fit_drives(logs, model_of(robot), DriveLaw.of(robot, kp=kp, kd=0.8, links=links))
        assert any("URDF" in text for text in fit.warnings) == told


def test_without_any_known_scale_only_ratios_are_determined(robot):
    logs = LogSet((commanded_log(robot, TRUTH, seed=3),))
    fit = fit_drives(logs, model_of(robot), DriveLaw.of(robot, kp="identify", kd=0.0, links="identify"))
    assert verdicts(fit)["kp_joint1"] == Standing.CONFOUNDED
    ratios = [c for c in fit.determination.combinations if c.expression.endswith("/ kp_joint1")]
    friction = next(c for c in ratios if c.expression.startswith("Fc_joint1"))
    assert abs(friction.value - 0.15 / 25.0) < 3.5 * friction.std + 0.002 * 0.15 / 25.0
    assert "mass" in friction.separated_by
    assert Standing.DETERMINED not in {v for k, v in verdicts(fit).items() if k != "delay"}


def test_a_scale_of_torque_is_none_without_a_known_load(robot):
    """Known gains are in the drive's own units where the scale of its torque is not known: everything is over that."""
    law = DriveLaw.of(robot, kp=25.0, kd=0.8, torque_scale="identify", links="identify")
    fit = fit_drives(ident.LogSet((commanded_log(robot, TRUTH, seed=2),)), model_of(robot), law)
    found = {c.expression: c for c in fit.determination.combinations}
    for expression, true in (("(Iyy_joint1 + Ia_joint1) / s_joint1", 0.026 + TRUTH["Ia"]), ("Fc_joint1 / s_joint1", TRUTH["Fc"])):
        assert abs(found[expression].value - true) < 4.0 * found[expression].std, expression
        assert found[expression].separated_by.startswith("torque_scale from the drive's settings")
    assert found["Fc_joint1 / s_joint1"].unit == "N m"
    for entry in fit.to_dict()["parameters"]:
        assert ("value" in entry) == (entry["name"] == "delay"), entry["name"]


def test_two_joints_that_act_on_each_other(tmp_path):
    robot = ident.Robot.from_urdf(LEG)
    logs = LogSet((commanded_log(robot, TRUTH, seed=4),))
    fit = fit_drives(logs, model_of(robot), DriveLaw.of(robot, kp=25.0, kd=0.8))
    for joint in ("hip", "knee"):
        assert fit.value(f"Ia_{joint}") == pytest.approx(0.012, rel=0.08)
        assert fit.value(f"Fc_{joint}") == pytest.approx(0.15, rel=0.05)
    assert fit.fit_rms == pytest.approx([5e-4, 5e-4], rel=0.15)
    again = DriveFit.load(fit.save(tmp_path / "fit.json"))
    assert again.replay(logs)["run"] == pytest.approx(fit.replay(logs)["run"], abs=1e-12)
    assert again.delay_interval()["delay"] == pytest.approx(fit.delay_interval()["delay"])


def test_springs_of_several_joints_are_each_joints_own():
    leg = ident.Robot.from_urdf(LEG)
    found = unknowns(leg.rigid_body() + ident.make_effect("linear_spring"), DriveLaw.of(leg, kp=25.0, kd=0.8, delay_s=0.0))
    places = {u.name: (u.place, leg.joint_names[u.joint]) for u in found}
    assert places == {
        "ks_hip": ("spring", "hip"), "ks0_hip": ("offset", "hip"), "ks_knee": ("spring", "knee"), "ks0_knee": ("offset", "knee"),
    }  # fmt: skip


def test_a_rotor_behind_a_spring_is_apart_from_a_link_that_nobody_weighed():
    """As one sum of both inertias, the rotor has none, and every start of the search diverges."""
    made = servos.servo("joint_elasticity", 1)
    t, q, sent = servos.recorded([made], [1])
    servo = ident.Robot.from_urdf(servos.URDF)
    spring = {"joint_stiffness": "identify", "joint_damping": "identify"}
    law = DriveLaw.of(servo, kp=made.kp, kd=made.kd, delay_s=made.delay, links="identify", **spring)
    fit = fit_drives(LogSet((ident.Log("run", t=t, q=q, extra={"q_cmd1": sent[:, 0]}),)), model_of(servo), law)
    assert fit.value("Ia_joint1") == pytest.approx(made.Ia, rel=0.02)
    assert fit.value("Iyy_joint1") == pytest.approx(servos.MASS * servos.LENGTH**2 + servos.INERTIA, rel=0.02)
    assert fit.value("k_joint1") == pytest.approx(made.stiffness, rel=0.02)
    assert {"Ia_joint1", "Iyy_joint1"} <= {u.expression or u.name for u in fit.unknowns}
    # Without a spring they are one.
    rigid = unknowns(model_of(servo), DriveLaw.of(servo, kp=made.kp, links="identify"))
    assert "Iyy_joint1 + Ia_joint1" in {u.expression for u in rigid}


@pytest.mark.parametrize(("sprung", "inertia"), [("hip", "Iyy_hip + 0.04 m_knee"), ("knee", "Iyy_hip + Ia_hip + 0.04 m_knee")])
def test_only_joints_with_a_spring_have_a_rotor_apart(sprung, inertia):
    leg = ident.Robot.from_urdf(LEG)
    stiffness = {joint: 100.0 if joint == sprung else np.inf for joint in leg.joint_names}
    law = DriveLaw.of(leg, kp=25.0, links="identify", joint_stiffness=stiffness)
    found = {u.expression or u.name: u.place for u in unknowns(model_of(leg), law)}
    assert found[inertia] == "link"
    assert ("Ia_hip" in found) == (sprung == "hip")


def test_saturation_is_part_of_the_law(robot):
    truth = {**TRUTH, "limit": 1.2}
    logs = LogSet((commanded_log(robot, truth, seed=5),))
    right = fit_drives(logs, model_of(robot), DriveLaw.of(robot, kp=25.0, kd=0.8, effort_limit=1.2))
    assert right.value("Fc_joint1") == pytest.approx(0.15, rel=0.08)
    assert right.fit_rms[0] == pytest.approx(5e-4, rel=0.2)


def test_a_voltage_that_is_read_between_pulses_counts_by_its_mean(robot):
    """Readings of 6.4 and 8.2 V of a supply of 7.3 V."""
    log = commanded_log(robot, {**TRUTH, "kd": 0.0, "Fv": 0.3}, seed=4)
    read = 7.3 + 0.9 * np.where(np.sin(7.1 * np.arange(len(log.t))) > 0.0, 1.0, -1.0)
    log = replace(log, extra={**log.extra, "supply1": read})
    law = {"kp": 0.2, "torque_scale": TRUTH["kp"] / (0.2 * 7.3), "back_emf": 0.0}
    fits = [fit_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, "pwm", supply=form, **law)) for form in ("logged", "mean")]
    friction = fits[1].values[fits[1].names.index("Fc_joint1")]
    assert friction == pytest.approx(TRUTH["Fc"], rel=0.05)
    assert fits[1].fit_rms[0] < 0.5 * fits[0].fit_rms[0]
    assert fits[1].law.to_dict()["supply"] == "mean"


def test_gains_that_are_hardly_distinguished_keep_their_intervals():
    """Two joints act on each other and all gains are unknown: with derivatives over narrow differences, rough by the corners of dry
    friction, a value is off by 4.5 of its standard deviations here."""
    found = coverage.one(coverage.MACHINES[1], "unknown", 500, 100)
    errors = {name: z for name, z, _ in found.values if name != coverage.PROFILE}
    assert {"kp_joint1", "kp_joint2", "kp_joint3"} <= set(errors)
    assert max(map(abs, errors.values())) < 3.5
    assert not found.missed
    assert not found.invented


def test_derivatives_along_a_joints_whole_torque_are_those_of_the_simulation():
    """A rotor that is heavy beside its link, gains unknown: all torque of that joint by another factor changes next to nothing, which is
    where errors of single derivatives would add up to more."""
    robot = ident.Robot.from_urdf(LEG)
    truth = {"Ia": [0.012, 0.1], "Fv": [0.1, 0.3], "Fc": [0.3, 0.3], "offset": 0.1, "kp": [25.0, 40.0], "kd": [0.8, 1.5], "delay": 0.006}
    log = commanded_log(robot, truth, seed=5, seconds=3.0, rate=200, before=1.0)
    law = DriveLaw.of(robot, kp="identify", kd="identify")
    plant = DrivePlant(model_of(robot), law, (DriveLog.of(log, robot, law),))
    values = np.array([truth["delay"] if u.joint < 0 else np.ones(2)[u.joint] * np.broadcast_to(truth[u.name.split("_")[0]], 2)[u.joint]
                       for u in plant.unknowns])  # fmt: skip
    search = SimulatedSearch(plant, log.q, starts(plant)[1], np.ones_like(log.q)).precise()
    _, slopes = search.linear(values, central=True)
    for joint in range(2):
        step = np.array([0.05 * v if u.joint == joint else 0.0 for u, v in zip(plant.unknowns, values, strict=True)])
        (more,), (less,) = (replace(plant, step=5e-5).positions(values + sign * step)[0] for sign in (1.0, -1.0))
        change = 0.5 * (more - less)
        assert np.linalg.norm(slopes @ step - change) < 0.02 * np.linalg.norm(change)
    # kd for viscous friction: nothing at all, while no velocity is commanded.
    names = [u.name for u in plant.unknowns]
    apart = slopes[..., names.index("kd_hip")] - slopes[..., names.index("Fv_hip")]
    assert np.abs(apart).max() < 1e-6 * np.abs(slopes[..., names.index("kd_hip")]).max()


def test_a_delays_profile_lies_about_its_value():
    """The fit ends in finer steps of time than its profile is looked at in. With the valley of the coarser ones, three joints at 500 Hz had
    ends at 3.2 standard deviations below and 1.0 above."""
    machine, seed = coverage.MACHINES[1], 3109
    leg, truth = machine.robot(), machine.truth(seed)
    log = commanded_log(leg, truth, seed=seed, seconds=coverage.SECONDS, rate=500, noise=coverage.NOISE, before=1.0)
    fit = fit_drives(LogSet((log,)), model_of(leg), DriveLaw.of(leg, kp=list(truth["kp"]), kd=list(truth["kd"])))
    value, low, high = fit.delay_interval()["delay"]
    std = np.sqrt(fit.covariance[-1, -1])
    assert 1.5 * std < value - low < 2.5 * std
    assert 1.5 * std < high - value < 2.5 * std


@pytest.mark.slow
def test_intervals_hold_the_truth_at_their_rate(robot):
    """Seeds fixed beforehand: 0 … 19."""
    inside = total = 0
    for seed in range(20):
        logs = LogSet((commanded_log(robot, TRUTH, seed=seed),))
        fit = fit_drives(logs, model_of(robot), DriveLaw.of(robot, kp=25.0, kd=0.8))
        for name, true in (("Ia_joint1", 0.012), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15), ("offset_joint1", 0.1), ("delay", 0.006)):
            i = fit.names.index(name)
            inside += abs(fit.values[i] - true) < 1.96 * np.sqrt(fit.covariance[i, i])
            total += 1
    assert 0.88 <= inside / total <= 1.0, inside / total


def test_known_gains_yield_the_torque_with_clipped_samples_left_out(robot):
    truth = {**TRUTH, "limit": 1.2}
    log = commanded_log(robot, truth, seed=6, noise=0.0)
    law = DriveLaw.of(robot, kp=25.0, kd=0.0, delay_s=0.0, effort_limit=1.2)
    (found,) = with_torque(LogSet((log,)), law, robot)
    asked = 25.0 * (log.extra["q_cmd1"] - log.q[:, 0])
    clipped = np.abs(asked) >= 1.2
    assert clipped.any()
    assert np.array_equal(np.isnan(found.tau["joint"][:, 0]), clipped)
    assert found.tau["joint"][~clipped, 0] == pytest.approx(asked[~clipped])
    with pytest.raises(ident.ConfigurationError, match="kp is to be identified"):
        with_torque(LogSet((log,)), DriveLaw.of(robot, kp="identify", delay_s=0.0), robot)


def test_what_a_law_refuses(robot):
    with pytest.raises(ident.ConfigurationError, match="needs kp"):
        DriveLaw.of(robot)
    with pytest.raises(ident.ConfigurationError, match="unknown \\[drive\\] law 'pd_positon'"):
        DriveLaw.of(robot, "pd_positon", kp=1.0)
    with pytest.raises(ident.ConfigurationError, match="2 values, but the robot has 1 joint "):
        DriveLaw.of(robot, kp=[1.0, 2.0])
    log = ident.Log("bare", t=np.arange(5) * 0.01, q=np.zeros((5, 1)))
    with pytest.raises(ident.DataError, match="needs the position commands, column q_cmd1"):
        fit_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, kp=1.0))


def write_study(folder, robot, drive: str):
    (folder / "pendulum.urdf").write_text(PENDULUM)
    for seed, name in ((0, "train"), (1, "held")):
        log = commanded_log(robot, TRUTH, seed=seed, seconds=5.0)
        rows = np.column_stack([log.t, log.q, log.extra["q_cmd1"]])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="time_s,q1_rad,q_cmd1_rad", comments="")
    text = f'[robot]\nurdf = "pendulum.urdf"\n[drive]\n{drive}\neffects = ["rotor_inertia", "viscous", "coulomb", "offset"]\n'
    (folder / "study.toml").write_text(text + '[logs]\nfit = ["train.csv"]\nvalidate = ["held.csv"]\n')
    return folder / "study.toml"


def test_the_command_line_from_study_to_mjcf(tmp_path, robot, ident):
    study = write_study(tmp_path, robot, 'law = "pd_position"\nkp = 25.0\nkd = 0.8')
    ran = ident("fit", study, "--out", tmp_path / "out", "--json")
    assert ran.code == 0, ran.err
    body = json.loads(ran.out)
    assert body["schema"] == "ident.fit/1"
    assert body["method"] == "simulation"
    assert body["replay"]["heldout"]["rms"][0] < 1e-3
    assert "delay from command to torque" in ran.err
    fit = DriveFit.load(tmp_path / "out/fit.json")
    assert fit.value("Ia_joint1") == pytest.approx(0.012, rel=0.15)
    assert '"name":"commanded"' in (tmp_path / "out/report.json").read_text()
    assert ident("report", tmp_path / "out/fit.json", "-o", tmp_path / "again.html").code == 0
    assert "our replay" in (tmp_path / "again.html").read_text()
    ran = ident("export", tmp_path / "out/fit.json", tmp_path / "arm.xml", "--to", "mujoco_actuator")
    assert ran.code == 0, ran.err
    assert "delay (up to" in ran.out
    text = (tmp_path / "arm.xml").read_text()
    assert "armature" in text
    assert "frictionloss" in text
    assert "gainprm" in text


def test_a_method_that_needs_torque_gets_that_of_the_law(tmp_path, robot, ident):
    study = write_study(tmp_path, robot, 'law = "pd_position"\nkp = 25.0\nkd = 0.8\ndelay_s = 0.006')
    ran = ident("fit", study, "--method", "wls")
    assert ran.code == 0, ran.err
    assert "Fc_joint1" in ran.out


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize(("branches", "joints"), [(2, 3), (3, 1), (1, 2), (2, 4), (1, 5), (1, 6), (1, 7), (1, 8)])
def test_the_compiled_step_does_what_the_plain_one_does(monkeypatch, branches, joints, loaded):
    """Branches of some joints (of up to seven by loops of their own), clipped and switched-off drives, friction of each kind."""
    pytest.importorskip("ident._native._recursions", reason="the compiled recursions were not built")
    rng = np.random.default_rng(5)
    lanes, n, steps = 3, branches * joints, 400
    root = rng.normal(size=(lanes, branches, joints, joints))
    H = np.zeros((lanes, n, n))
    for branch in range(branches):
        at = slice(joints * branch, joints * branch + joints)
        H[:, at, at] = 0.3 / joints * root[:, branch] @ np.swapaxes(root[:, branch], 1, 2) + 0.05 * np.eye(joints)

    class Links:
        def terms(self, q, dq):
            return H, 0.5 * np.sin(q) + 0.01 * dq

    some = lambda size: size * rng.uniform(0.5, 1.5, (lanes, n))  # noqa: E731
    nothing = np.zeros((lanes, n))
    drives = simulate.LaneDrives(
        armature=some(0.02), viscous=some(0.1), dry=some(0.3), load=some(0.1) if loaded else nothing,
        excess=some(0.2) if loaded else nothing, fall=some(0.5), offset=some(0.1), kp=some(20.0), kd=some(0.5), limit=some(6.0),
        back_emf=some(0.05), spring=some(0.5), loss=some(0.1) if loaded else nothing, loss_square=some(0.02) if loaded else nothing,
        loss_slow=some(0.1) if loaded else nothing, slow=some(0.5),
    )  # fmt: skip
    time = 0.002 * np.arange(steps)[:, None, None]
    target = drives.kp * np.sin(6.0 * time + rng.uniform(0.0, 6.0, (lanes, n)))
    strength = np.where((time > 0.5) & (time < 0.6), 0.0, 1.0) * np.ones_like(target)
    groups = [slice(k, None, joints) for k in range(joints)]
    run = lambda: simulate.simulated(Links(), drives, target, strength, nothing, nothing, 0.002, groups)  # noqa: E731
    monkeypatch.setenv("IDENT_KERNEL", "native")
    compiled = run()
    monkeypatch.setenv("IDENT_KERNEL", "numpy")
    assert np.ptp(compiled, axis=0).max(axis=0).min() > 0.1  # every joint moves in some lane
    np.testing.assert_allclose(compiled, run(), atol=1e-9)


def test_a_constant_is_asked_where_single_logs_only_have_it(robot):
    """A law that says "identify" means it, though a log has a number of its own; what only logs have is not asked."""
    names = {u.name for u in unknowns(model_of(robot), DriveLaw.of(robot, kp="identify", kd=0.8, by_log={"other*": {"kp": 20.0}}))}
    assert "kp_joint1" in names
    names = {u.name for u in unknowns(model_of(robot), DriveLaw.of(robot, kd=0.8, by_log={"other*": {"kp": 20.0}}))}
    assert "kp_joint1" not in names
    back = DriveLaw.of(robot, kd=0.8, by_log={"other*": {"kp": 20.0}}).to_dict()
    assert "kp" not in back


def test_a_part_of_a_log_has_the_law_of_the_log(robot):
    """The last part, which a fit without validation logs holds out, had the law of all logs: there kp was nothing."""
    law = DriveLaw.of(robot, kd=0.8, by_log={"run": {"kp": 25.0}, "run (2)": {"kp": 12.0}})
    gains = {
        name: law.for_log(name).constants["kp"][0] for name in ("run", "run (last part)", "run (part 3)", "run (2)", "run (2) (last part)")
    }
    assert gains == {"run": 25.0, "run (last part)": 25.0, "run (part 3)": 25.0, "run (2)": 12.0, "run (2) (last part)": 12.0}
    assert np.isnan(law.for_log("run (3)").constants["kp"][0])
    logs = ident.LogSet((commanded_log(robot, TRUTH, seed=2),))
    first, last = logs.split(by="fraction")
    fit = fit_drives(first, model_of(robot), DriveLaw.of(robot, kd=0.8, by_log={"run": {"kp": 25.0}}), held=last)
    assert fit.heldout_rms[0] < 2e-3


def test_derivatives_keep_to_joints_that_have_mass(robot):
    """Beside next to no inertia (gains and load unknown) a step back is one to negative mass: it moves beyond every bound, and all
    derivatives, which agree along directions, went with it. Then nothing was said to be determined, not even ratios to kp."""
    log = commanded_log(robot, TRUTH, seed=2)
    law = DriveLaw.of(robot, kp="identify", kd="identify", links="identify")
    plant = DrivePlant(model_of(robot), law, (DriveLog.of(log, robot, law),))
    at, sizes = starts(plant)
    values = at[0].copy()
    inertia = next(i for i, u in enumerate(plant.unknowns) if u.name.startswith("Iyy"))
    values[inertia] = 1e-3 * sizes[inertia]
    assert not plant.possible(values[None] - 0.06 * sizes * (np.arange(len(values)) == inertia)).any()
    search = SimulatedSearch(plant, plant.logs[0].q, sizes, np.ones_like(log.q))
    central, ahead = search.linear(values, central=True)[1], search.along(values, np.arange(len(values)))
    for i, unknown in enumerate(plant.unknowns):
        one, other = central[..., i].ravel(), ahead[..., i].ravel()
        assert np.linalg.norm(one - other) < 0.5 * np.linalg.norm(other), unknown.name


def test_units_are_those_of_the_law_and_of_the_joint():
    """By the equations: a slide has a force, of a share of full voltage the limit is one, too."""
    slide = ident.Robot.from_urdf(LEG.replace('name="knee" type="revolute"', 'name="knee" type="prismatic"'))
    every = {
        "pd_position": {
            "kp": "N m/rad N/m", "kd": "N m s/rad N s/m", "delay": "s", "lag": "s", "deadband": "rad m", "effort_limit": "N m N",
            "s": "1 1", "ke": "N m s/rad N s/m", "Fm": "1 1", "Fmm": "1/(N m) 1/N", "v_m": "rad/s m/s", "k": "N m/rad N/m",
            "d": "N m s/rad N s/m", "f": "1 1", "v0": "rad/s m/s",
        },
        "pid_position": {"ki": "N m/(rad s) N/(m s)", "I0": "N m N"},
        "pwm": {"kp": "1/rad 1/m", "kd": "s/rad s/m", "effort_limit": "1 1", "s": "N m/V N/V", "deadband": "rad m"},
        "voltage": {"effort_limit": "V V", "s": "N m/V N/V"},
    }  # fmt: skip
    keys = {CONSTANTS[key][0]: key for key in CONSTANTS}
    model = slide.rigid_body()
    for kind, units in every.items():
        given = {keys[symbol]: "identify" for symbol in units}
        law = DriveLaw.of(slide, kind, **{"kp": "identify"} | given) if kind != "voltage" else DriveLaw.of(slide, kind, **given)
        found = {u.name: u.unit for u in unknowns(model, law, [("run", 0), ("run", 1)] if kind == "pid_position" else [])}
        for symbol, both in units.items():
            of = [found[name] for name in found if name == symbol or name.startswith((f"{symbol}_hip", f"{symbol}_knee"))]
            assert " ".join(of) == both, (kind, symbol)
