"""Drives whose limit falls with speed: the straight line from stall torque to no-load speed; the compiled step, with deadbands too."""

from __future__ import annotations

import numpy as np
import pytest
from drive_pendulum import INERTIA, LANES, WEIGHT, lanes_of, model_of, pendulum, written
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import command
from ident.drives import DriveFit, DriveLaw, fit_drives, simulate
from ident.drives.links import ElasticLinks, KnownLinks
from ident.drives.torque import with_torque

pytestmark = needs_native

TRUTH = {"kp": 25.0, "kd": 0.8, "Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "delay": 0.006, "limit": 4.0, "v0": 6.0}
KNOWN = {"kp": 25.0, "kd": 0.8, "effort_limit": 4.0}


@pytest.fixture(scope="module")
def robot():
    return pendulum()


def run(sent: np.ndarray, rate: int, ki: float = 0.0) -> np.ndarray:
    """Position, speed, torque of the drive and whether it is at its limit (4, N) at the samples, in steps of 20 µs."""
    every = 50_000 // rate
    h, late = 1.0 / (rate * every), round(TRUTH["delay"] * rate * every)
    inertia, limit, v0, q, dq, wound, out = INERTIA + TRUTH["Ia"], TRUTH["limit"], TRUTH["v0"], 0.0, 0.0, 0.0, []
    for k in range(len(sent) * every):
        error = sent[max(k - late, 0) // every] - q
        asked = TRUTH["kp"] * error - TRUTH["kd"] * dq + wound
        low, high = -min(limit, limit * (1.0 + dq / v0)), min(limit, limit * (1.0 - dq / v0))
        given = low if asked < low else min(asked, high)
        if given == asked or error * (asked - given) < 0.0:
            wound += h * ki * error
        if k % every == 0:
            out.append((q, dq, given, float(given != asked)))
        torque = given - TRUTH["Fv"] * dq - WEIGHT * np.sin(q)
        moved, most = dq + h * torque / inertia, h * TRUTH["Fc"] / inertia
        dq = 0.0 if abs(moved) <= most else moved - (most if moved > 0.0 else -most)
        q += h * dq
    return np.array(out).T


def wide(seed: int, seconds: float = 5.0, rate: int = 200) -> np.ndarray:
    """(N,) commands that ask for more speed than there is."""
    return 2.5 * command(seed, seconds, rate, 1)[:, 0]


def driven(seed: int, *, ki: float = 0.0, noise: float = 5e-4) -> ident.Log:
    sent = wide(seed)
    q = run(sent, 200, ki)[0] + noise * np.random.default_rng([seed, 1]).standard_normal(len(sent))
    return ident.Log(f"run{seed}", t=np.arange(len(sent)) / 200, q=q[:, None], extra={"q_cmd1": sent})


def fitted(robot, log, kind: str = "pd_position", **given) -> DriveFit:
    return fit_drives(ident.LogSet((log,)), model_of(robot), DriveLaw.of(robot, kind, **given))


def off_by(fit: DriveFit, name: str, true: float) -> float:
    """How many of its standard deviations a determined value is away from the truth."""
    i = fit.names.index(name)
    assert fit.determination.verdicts[i] == "determined", name
    return abs(float(fit.values[i]) - true) / float(fit.determination.std[i])


def test_a_declared_curve_and_one_that_is_not(robot):
    log = driven(1)
    right = fitted(robot, log, no_load_speed=6.0, **KNOWN)
    assert right.fit_rms[0] < 6e-4
    for name, true in (("Ia_joint1", 0.012), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15), ("delay", 0.006)):
        assert off_by(right, name, true) < 4.0, name
    assert fitted(robot, log, **KNOWN).fit_rms[0] > 20 * right.fit_rms[0]


def test_an_unknown_curve(robot):
    fit = fitted(robot, driven(2), no_load_speed="identify", kp=25.0, kd=0.8, effort_limit="identify")
    assert fit.fit_rms[0] < 6e-4
    for name, true in (("v0_joint1", 6.0), ("Ia_joint1", 0.012), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15), ("delay", 0.006)):
        assert off_by(fit, name, true) < 4.0, name
    # A step of time in which the limit sets in is at it as a whole or not at all: 0.1 % of the limit.
    assert fit.value("effort_limit_joint1") == pytest.approx(4.0, rel=0.003)
    assert fit.value("v0_joint1") == pytest.approx(6.0, rel=0.005)
    assert {u.name: u.unit for u in fit.unknowns}["v0_joint1"] == "rad/s"


def test_slow_motion_says_nothing_of_it(robot):
    """Nothing at its limit: no number, and no bound."""
    sent = 0.3 * command(1, 4.0, 200, 1)[:, 0]
    q, _, _, clipped = run(sent, 200)
    assert not clipped.any()
    q = q + 5e-4 * np.random.default_rng(1).standard_normal(len(q))
    fit = fitted(
        robot, ident.Log("slow", t=np.arange(len(q)) / 200, q=q[:, None], extra={"q_cmd1": sent}), no_load_speed="identify", **KNOWN
    )
    (entry,) = (one for one in fit.to_dict()["parameters"] if one["name"] == "v0_joint1")
    assert entry["verdict"] == "unseen"
    assert not {"value", "below"} & set(entry)


def test_with_an_integral(robot):
    fit = fitted(robot, driven(3, ki=30.0), "pid_position", no_load_speed=6.0, ki="identify", integral_start=0.0, **KNOWN)
    assert fit.fit_rms[0] < 6e-4
    assert off_by(fit, "ki_joint1", 30.0) < 4.0


@pytest.mark.parametrize("ki", [0.0, 30.0])
def test_known_constants_give_the_torque(robot, ki):
    sent = wide(4)
    q, dq, torque, clipped = run(sent, 200, ki)
    log = ident.Log("run", t=np.arange(len(q)) / 200, q=q[:, None], dq=dq[:, None], extra={"q_cmd1": sent})
    law = DriveLaw.of(robot, "pid_position", no_load_speed=6.0, delay_s=0.006, ki=ki, integral_start=0.0, **KNOWN)
    found = with_torque(ident.LogSet((log,)), law, robot)[0].tau["joint"][:, 0]
    assert 0.1 < clipped.mean() < 0.9
    assert np.mean(np.isnan(found) != (clipped > 0.0)) < 0.01
    both = np.isfinite(found) & (clipped == 0.0)
    np.testing.assert_allclose(found[both], torque[both], atol=0.03 if ki else 1e-9)


@pytest.mark.parametrize("part", ["droop", "band"])
@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize(("joints", "elastic"), [(1, False), (1, True), (3, False)])
def test_the_compiled_step_does_what_the_plain_one_does(monkeypatch, joints, elastic, integral, part):
    pytest.importorskip("ident._native._recursions", reason="the compiled recursions were not built")
    rng = np.random.default_rng(6)
    lanes, n, steps, h = LANES, joints, 500, 0.002
    links, some = lanes_of(n, rng)
    none = np.zeros((lanes, n))
    size = some({"droop": 1.0, "band": 0.1}[part])
    size[0] = 0.0  # one lane without
    drives = simulate.LaneDrives(
        armature=some(0.02), viscous=some(0.1), dry=some(0.1), load=none, excess=none, fall=some(0.5), offset=some(0.1), kp=some(20.0),
        kd=some(0.5), limit=some(4.0), back_emf=none, spring=none, loss=none, loss_square=none, loss_slow=none, slow=some(0.5),
        **{part: size},
    )  # fmt: skip
    time = h * np.arange(steps)[:, None, None]
    wanted = 2.0 * np.sin(6.0 * time + rng.uniform(0.0, 6.0, (lanes, n)))
    # The commands of a deadband come with integrals, of gain 0 where there are none.
    own = simulate.LaneIntegrals(float(integral) * some(30.0), wanted, float(integral) * some(0.5)) if integral or part == "band" else None
    groups, target, q = [slice(j, j + 1) for j in range(n)], drives.kp * wanted, none
    if elastic:
        links = ElasticLinks(links, 1, np.array([0]), some(200.0), some(0.1))
        drives, target, q, groups = links.drives(drives), links.widened(target), links.resting(none), links.groups
        own = None if own is None else links.integrals(own)

    def moving(given):
        return simulate.simulated(links, given, target, None, q, np.zeros_like(q), h, groups, own)

    flat = simulate.LaneDrives(**{**vars(drives), part: None})
    monkeypatch.setenv("IDENT_KERNEL", "native")
    compiled, without = moving(drives), moving(flat)
    monkeypatch.setenv("IDENT_KERNEL", "numpy")
    apart = np.abs(compiled - without)[..., :n].max(axis=(0, 2))
    assert apart[0] == 0.0  # a limit that does not fall, and a deadband of nothing, are the plain ones
    assert apart[1:].min() > 0.01
    np.testing.assert_allclose(compiled, moving(drives), atol=1e-9)
    np.testing.assert_allclose(without, moving(flat), atol=1e-9)


def test_a_joint_driven_beyond_the_no_load_speed_is_braked(robot):
    """A link that is thrown at twice the speed, its drive asked to go on: it comes down to what the curve lets it."""
    one = lambda x: np.full((1, 1), x)  # noqa: E731
    given = {
        key: one(0.0) for key in ("viscous", "dry", "load", "excess", "offset", "back_emf", "spring", "loss", "loss_square", "loss_slow")
    }
    drives = simulate.LaneDrives(
        armature=one(5.0), kp=one(1e3), kd=one(0.0), limit=one(4.0), fall=one(1.0), slow=one(1.0), droop=one(4.0 / 6.0), **given
    )
    target = np.full((4000, 1, 1), 1e6)
    q = simulate.simulated(KnownLinks(robot, 0.0 * robot.nominal), drives, target, None, one(0.0), one(12.0), 0.01, [slice(0, 1)])[:, 0, 0]
    speed = np.diff(q) / 0.01
    t = 0.01 * (np.arange(4000) + 0.5)
    np.testing.assert_allclose(speed, 6.0 + 6.0 * np.exp(-t * 4.0 / 6.0 / 5.0), atol=1e-3)


def test_what_is_refused(robot):
    with pytest.raises(ident.ConfigurationError, match="give effort_limit too, and a speed above zero"):
        DriveLaw.of(robot, kp=1.0, no_load_speed=6.0)
    with pytest.raises(ident.ConfigurationError, match="give effort_limit too, and a speed above zero"):
        DriveLaw.of(robot, kp=1.0, effort_limit=1.0, no_load_speed=0.0)
    for law in ("pwm", "voltage"):
        with pytest.raises(ident.ConfigurationError, match="'no_load_speed'"):
            DriveLaw.of(robot, law, no_load_speed=6.0, **({"kp": 1.0} if law == "pwm" else {}))
    DriveLaw.of(robot, kp=1.0, no_load_speed=6.0, by_log={"a*": {"effort_limit": 2.0}, "b*": {"effort_limit": 1.0}})


def test_from_a_study_to_simulators(tmp_path, ident):
    written(tmp_path, {"train": driven(1), "held": driven(2)})
    (tmp_path / "study.toml").write_text(
        '[robot]\nurdf = "pendulum.urdf"\n[drive]\nlaw = "pd_position"\nkp = 25.0\nkd = 0.8\neffort_limit = 4.0\n'
        'no_load_speed = "identify"\n'
        'effects = ["rotor_inertia", "viscous", "coulomb"]\n[logs]\nfit = ["train.csv"]\nvalidate = ["held.csv"]\n'
    )
    ran = ident("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    assert DriveFit.load(tmp_path / "out/fit.json").heldout_rms[0] < 1e-3
    for kind in ("mujoco_actuator", "isaaclab", "genesis"):
        ran = ident("export", tmp_path / "out/fit.json", tmp_path / f"arm.{kind}", "--to", kind, "--log", tmp_path / "held.csv")
        assert ran.code == 0, (kind, ran.err)
        said = " ".join(ran.out.split())
        assert "not expressible: fall of the limit with speed; without it the simulated position changes by 0." in said, kind
        assert "falls to nothing at joint1 6" in said or "falls to nothing at joint1 5.99" in said
    for kind in ("json", "ranges"):
        ran = ident("export", tmp_path / "out/fit.json", tmp_path / f"arm.{kind}", "--to", kind)
        assert ran.code == 0, (kind, ran.err)
    assert '"no_load_speed"' in (tmp_path / "arm.json").read_text()
