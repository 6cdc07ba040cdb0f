"""The decision rule: instruments against feedback, one scale, verdicts by the set of adequate models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

import ident
from benchmarks.diagnosis.feedback.world import Case, geared, simulated
from ident.diagnosis import Verdict
from ident.diagnosis.confidence import confidence
from ident.diagnosis.held_out import contradicted, contradicted_heap, heaps, presence
from ident.diagnosis.inference import candidates
from ident.diagnosis.inference.bursts import burst
from ident.diagnosis.inference.confidence_set import AcceptedEffect, Member
from ident.diagnosis.inference.described import outdone
from ident.diagnosis.inference.scores import z_of
from ident.effects.motion import Motion
from ident.instruments.band import Band
from ident.instruments.whitening import density
from tests.searches import searched, with_torque

Array = np.ndarray
PENDULUM = """<robot name="one"><link name="a"/><link name="b"><inertial><origin xyz="0 0 -.3"/><mass value="10"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" velocity="9" effort="900"/></joint></robot>"""


def diagnosed(case: Case) -> ident.Diagnosis:
    before = ident.fit(case.log, case.robot, model=case.model, held=0)
    return ident.diagnose(before, ident.ZeroPhase()(case.held, case.robot))


@pytest.fixture(scope="module")
def arm() -> tuple[ident.Robot, dict[str, Array]]:
    return geared("scara", 50.0)


def cases(arm: tuple[ident.Robot, dict[str, Array]], missing: list[tuple[ident.Effect, Array]], seeds: list[int]) -> list[Case]:
    robot, drive = arm
    return simulated(robot, drive, missing, seeds, seconds=24.0, rate=250.0)


@pytest.fixture(scope="module")
def nothing_missing(arm: tuple[ident.Robot, dict[str, Array]]) -> list[Case]:
    return cases(arm, [], [101, 102])


@pytest.mark.parametrize(
    ("share", "wholly"), [((1.0, 0.01), True), ((0.96, 0.04), True), ((1.0, 0.2), False), ((0.8, 0.01), False), ((np.nan, np.nan), False)]
)
def test_what_held_out_data_wholly_confirm_is_more_than_a_hint_beside_what_is_left(share: tuple[float, float], wholly: bool) -> None:
    found = AcceptedEffect(ident.make_effect("offset"), (), 30.0)
    assert (confidence(found, beside=True, share=share)[0] > 0.5) is wholly
    assert confidence(found, beside=False, share=share)[0] >= confidence(found, beside=True, share=share)[0]


@pytest.mark.parametrize(
    ("share", "hint"),
    [((-0.7, 1.7), True), ((1.0, 0.5), True), ((0.7, 0.05), True), ((1.5, 0.1), False), ((1.0, 0.2), False), ((0.94, 0.01), False)]
    + [((np.nan, np.nan), False)],
)
def test_what_held_out_data_do_not_tell_from_nothing_or_have_less_of_is_a_hint(share: tuple[float, float], hint: bool) -> None:
    found = AcceptedEffect(ident.make_effect("offset"), (), 30.0)
    assert (confidence(found, beside=False, share=share)[0] < 0.5) is hint


@pytest.mark.parametrize(
    ("extra", "gain", "needless"),
    [(1, 0.0, True), (1, 6.8, True), (1, 7.0, False), (2, 13.7, True), (2, 14.0, False), (0, 0.0, False), (-1, 0.0, False)],
)
def test_what_asks_for_more_competes_where_it_tells_more(extra: int, gain: float, needless: bool) -> None:
    """A parameter more must gain the logarithm of the rows (Schwarz): 6.91 of 1000."""
    z = 10.0
    spring, counterbalance = ident.make_effect("linear_spring"), ident.make_effect("counterbalance")
    member = Member(counterbalance, (), float(np.sqrt(z**2 + gain)), 0.0, extra=extra).beside(z, rows=1000)
    assert member.needless is needless
    accepted = AcceptedEffect(spring, (), z, (member,))
    assert accepted.ambiguous is not needless
    own, (other,) = confidence(accepted, beside=False)
    assert (own > 0.8) is needless
    assert (other.confidence > 0.2) is not needless


@pytest.fixture(scope="module")
def one_sided(arm: tuple[ident.Robot, dict[str, Array]]) -> Case:
    """Friction of a joint differs by direction, and so it is found."""
    robot, drive = arm
    effect = ident.make_effect("asymmetric_coulomb", joints=[robot.joint_names[1]], label="+")
    (case,) = cases(arm, [(effect, np.array([0.8 * float(drive["Fc"][1])]))], [112])
    found = diagnosed(case)
    assert found.verdict is Verdict.EXPLAINED, str(found)
    return case


def test_a_finding_that_held_out_data_cannot_show_is_ambiguous(one_sided: Case) -> None:
    """Held-out data in which the joint hardly moves say nothing of its friction."""
    case, robot = one_sided, one_sided.robot
    still = np.where(np.arange(robot.n) == 1, np.mean(case.held.q, axis=0), case.held.q)
    ((side, tau),) = case.held.tau.items()
    before = ident.fit(case.log, robot, model=case.model, held=0)
    resting = replace(case.held, q=still, tau={side: np.where(np.arange(robot.n) == 1, np.mean(tau, axis=0), tau)})
    other = ident.diagnose(before, ident.ZeroPhase()(resting, robot))
    assert other.verdict is not Verdict.EXPLAINED, str(other)


@pytest.mark.slow
def test_a_finding_of_another_size_on_held_out_data_is_ambiguous(arm: tuple[ident.Robot, dict[str, Array]], one_sided: Case) -> None:
    """Three quarters of it act there: too much to rule it out, too little to be what was found."""
    (effect,), sizes = one_sided.missing, np.asarray(one_sided.sizes)
    (less,) = cases(arm, [(effect, 0.75 * sizes)], [112])
    found = diagnosed(replace(one_sided, held=less.held))
    assert found.verdict is Verdict.AMBIGUOUS, str(found)
    (finding,) = found.findings
    assert finding.presence[0] == pytest.approx(0.75, abs=0.1)
    assert finding.confidence < 0.5


def test_nothing_is_found_where_friction_fluctuates_under_feedback(nothing_missing: list[Case]) -> None:
    for case in nothing_missing:
        found = diagnosed(case)
        assert found.verdict is Verdict.CLEAN, str(found)
        assert not found.findings


@pytest.mark.parametrize(
    ("name", "share"),
    [("offset", 0.8), pytest.param("linear_spring", 1.0, marks=pytest.mark.slow)],
    ids=["offset", "linear_spring"],
)
def test_an_effect_is_named_alone_where_it_is(arm: tuple[ident.Robot, dict[str, Array]], name: str, share: float) -> None:
    robot, drive = arm
    effect = ident.make_effect(name, joints=[robot.joint_names[1]], label="+")
    units = {"offset": drive["Fc"][1], "linear_spring": 50.0 * drive["Fc"][1]}
    size = share * float(units[name])
    (case,) = cases(arm, [(effect, np.full(len(effect.parameters(robot)), size))], [103])
    found = diagnosed(case)
    first = found.findings[0]
    assert (first.name, first.joints) == (name, effect.joints), str(found)
    assert len(found.findings) == 1
    assert abs(first.parameters[0].value - size) < 4.0 * first.parameters[0].std + 0.05 * abs(size)
    assert found.comparison.error_after.relative_all < found.comparison.error_before.relative_all


def test_rows_of_the_band_are_linear_and_hold_slow_motion_exactly() -> None:
    band = Band(2000, 250.0, 5, 20.0)
    t = np.arange(2000) / 250.0
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 2000, 1))
    np.testing.assert_allclose(band.rows(2.0 * x - y), 2.0 * band.rows(x) - band.rows(y), atol=1e-12)
    slow = np.sin(2 * np.pi * 1.5 * t)[:, None]
    rows = band.rows(slow)[band.inner, 0]
    np.testing.assert_allclose(rows, np.sin(2 * np.pi * 1.5 * band.time), atol=2e-3)
    fast = np.sin(2 * np.pi * 60.0 * t)[:, None]
    assert np.abs(band.rows(fast)[band.inner]).max() < 1e-3


@pytest.mark.parametrize("degrees", [1, 3, 8])
def test_the_z_scale_has_the_probability_of_its_squares(degrees: int) -> None:
    squares = np.array([[0.5, 9.0, 40.0, 2000.0]])
    z = z_of(squares, np.array([degrees]))[0]
    np.testing.assert_allclose(2 * norm.sf(z[:3]), chi2.sf(squares[0, :3], degrees), rtol=1e-6)
    assert np.all(np.diff(z) > 0)
    assert np.isfinite(z).all()


def test_the_density_of_white_noise_is_flat_at_its_level() -> None:
    e = 0.3 * np.random.default_rng(1).normal(size=3000)
    level = density(e, 50.0, 20.0)(np.array([2.0, 5.0, 10.0, 15.0]))
    np.testing.assert_allclose(level, 0.3**2 / 50.0, rtol=0.35)


def test_a_saved_estimate_without_signals_is_refused() -> None:
    train, _ = ident.demo_logs()
    estimate = ident.fit(train, "puma560", held=0)
    with pytest.raises(ident.ConfigurationError, match="signals"):
        ident.diagnose(replace(estimate, problem=None))


def concave(seed: int) -> ident.LogSet:
    """A pendulum whose friction grows less than in proportion to speed: 12 sign ω + 30 ω - 4.4 ω|ω| (N m), always resisting."""
    rng, t = np.random.default_rng(seed), np.arange(8000) / 200.0
    w = 4 * np.pi * np.arange(1, 9) / 40.0
    a, b = rng.normal(size=(2, 8)) / np.arange(1, 9)
    angle = np.outer(t, w)
    q = np.sin(angle) @ a + (np.cos(angle) - 1) @ b
    v = np.cos(angle) @ (a * w) - np.sin(angle) @ (b * w)
    acceleration = -np.sin(angle) @ (a * w**2) - np.cos(angle) @ (b * w**2)
    tau = 9 * acceleration + 30 * np.sin(q) + 12 * np.sign(v) + 30 * v - 4.4 * v * np.abs(v) + 0.8 * rng.normal(size=t.size)
    q = q + 2e-6 * rng.normal(size=t.size)
    return ident.LogSet((ident.Log(f"run {seed}", t, q=q[:, None], tau={"joint": tau[:, None]}),), ident.Robot.from_urdf(PENDULUM))


def elastic(seed: int, stiffness: float) -> ident.LogSet:
    """A pendulum behind an elastic gear, its encoder on the motor: the link's motion gives the spring's torque and the motor's angle."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 60.0, 0.004)
    w = 2 * np.pi * np.array([0.1, 0.23, 0.41, 0.67])
    a, phase = np.array([0.8, 0.5, 0.25, 0.1]) * rng.uniform(0.8, 1.2, 4), rng.uniform(0.0, 6.0, 4)
    angle = t[:, None] * w + phase
    link, acceleration = np.sin(angle) @ a, -np.sin(angle) @ (a * w**2)
    spring = 1.9 * acceleration + 29.43 * np.sin(link)
    q = link + spring / stiffness
    v = np.gradient(q, t)
    tau = spring + 3.0 * np.tanh(v / 1e-3) + 2.0 * v + 0.1 * rng.normal(size=t.size)
    q = q + 2e-6 * rng.normal(size=t.size)
    return ident.LogSet((ident.Log(f"run {seed}", t, q=q[:, None], tau={"joint": tau[:, None]}),), ident.Robot.from_urdf(PENDULUM))


def test_an_elastic_joint_is_named_with_its_stiffness_by_what_gives_under_load() -> None:
    """Slow motion, far below the resonance of 4 Hz: its link sags under its weight, which an eccentric encoder would imitate."""
    before = ident.fit(elastic(1, 1200.0), model=[ident.make_effect(e) for e in ("viscous", "coulomb")], held=0)
    found = ident.diagnose(before, ident.ZeroPhase()(elastic(2, 1200.0)))
    (finding,) = found.findings
    assert (finding.name, finding.joints) == ("joint_elasticity", ("j1",)), str(found)
    (share, stiffness) = finding.parameters
    assert (share.name, stiffness.name) == ("elastic_j1", "stiffness"), "the rotor and the damping are taken, not found"
    assert stiffness.value == pytest.approx(1200.0, rel=0.1)
    assert stiffness.std / stiffness.value == pytest.approx(share.std, rel=0.05)
    assert found.comparison.error_after.relative_all < 0.5 * found.comparison.error_before.relative_all


def test_an_encoder_out_of_true_swings_its_scale_by_little(arm: tuple[ident.Robot, dict[str, Array]]) -> None:
    effect = ident.make_effect("encoder_eccentricity", joints=[arm[0].joint_names[0]], order=4.0)
    known = np.full(2, 1e-4)
    assert effect.implausible(arm[0], np.array([0.1, 0.06]), known), "a scale that is off by half"
    assert not effect.implausible(arm[0], np.array([0.01, 0.01]), known)
    assert not effect.implausible(arm[0], np.array([0.1, 0.06]), np.full(2, 0.05)), "it may be small"


def test_of_concave_friction_the_power_that_resists_is_kept() -> None:
    """Beside viscous friction, Fn |ω|^a with a < 1 has a mirror a > 1 with Fn < 0. The shape once went there, and was taken back."""
    train, held = concave(1), concave(2)
    before = ident.fit(train, model=[ident.make_effect(e) for e in ("viscous", "coulomb")], held=0)
    prepare = ident.ZeroPhase(cutoff_hz=8.0)
    found = ident.diagnose(before, prepare(held), fit=prepare(train))
    (finding,) = found.findings
    assert (finding.name, finding.joints) == ("nonlinear_viscous", ("j1",))
    values = {p.name: p.value for p in finding.parameters}
    assert values["a"] < 1.0
    assert values["Fn_j1"] > 0
    assert found.comparison.error_after.relative_all < 0.5 * found.comparison.error_before.relative_all


def test_what_has_no_name_is_described_by_what_it_follows_and_names_nothing(arm: tuple[ident.Robot, dict[str, Array]]) -> None:
    robot, drive = arm
    size = 1.5 * float(drive["Fc"][0])

    def bundle(motion: Motion, t: Array) -> Array:
        """Dry friction of the first motor that grows with where the second joint stands, behind its gear of 50."""
        out = np.zeros_like(motion.motor.dq)
        out[:, 0] = 50.0 * size * motion.joint.q[:, 1] * np.tanh(motion.motor.dq[:, 0] / 0.2)
        return out

    (case,) = simulated(robot, drive, [], [109], seconds=24.0, rate=250.0, law=bundle)
    found = diagnosed(case)
    assert found.verdict is Verdict.UNEXPLAINED, str(found)
    assert found.description is not None
    law = found.description.laws[0]
    assert (law.effect.joints, law.effect.by, law.effect.turned) == ((robot.joint_names[0],), robot.joint_names[1], "direction")
    assert found.description.confirmed
    errors = found.description.comparison
    assert errors.error_after.relative[0] < 0.3 * errors.error_before.relative[0]
    slope = np.polyfit(law.x, law.y, 1)[0]
    assert abs(abs(slope) - size) < 0.15 * size
    assert all(f.confidence < 0.5 for f in found.findings)


@pytest.mark.parametrize("order", [7.37, pytest.param(8.0, marks=pytest.mark.slow)])
def test_the_order_of_a_wheel_between_motor_and_joint_is_found(arm: tuple[ident.Robot, dict[str, Array]], order: float) -> None:
    robot, drive = arm
    effect = ident.make_effect("cogging", joints=[robot.joint_names[1]], label="+", angle="joint", order=order)
    size = 0.6 * float(drive["Fc"][1])
    (case,) = cases(arm, [(effect, np.array([size, 0.3 * size]))], [110])
    found = diagnosed(case)
    assert [(f.name, f.joints) for f in found.findings] == [("cogging", effect.joints)], str(found)
    assert abs(found.findings[0].effect.order - order) < (0.01 * order if order != 8.0 else 1e-12)


def test_a_finding_of_which_nothing_is_there_on_data_held_out_is_said() -> None:
    offset = AcceptedEffect(ident.make_effect("offset"), ("joint1",), 10.0)
    cases = [(0.97, 0.02), (0.02, 0.1), (0.02, 0.6), (0.35, 0.11), (0.6, 0.01), (np.nan, np.nan)]
    assert [len(contradicted([offset], [x])) for x in cases] == [0, 1, 0, 1, 0, 0]


def test_what_is_named_on_one_joint_together_is_judged_together() -> None:
    names = (("offset", "joint1"), ("cogging", "joint2"), ("stribeck", "joint1"))
    named = [AcceptedEffect(ident.make_effect(name, joints=[j]), (j,), 10.0) for name, j in names]
    assert heaps(named) == [[0, 2]]
    (said,) = contradicted_heap([named[0], named[2]], (0.2, 0.2))
    assert said.joint == "joint1"
    assert not contradicted_heap([named[0], named[2]], (0.8, 0.2))


def test_a_tone_is_said_with_its_frequency(arm: tuple[ident.Robot, dict[str, Array]], nothing_missing: list[Case]) -> None:
    case = nothing_missing[0]
    size = 0.3 * float(arm[1]["Fc"][1]) * 50.0
    found = diagnosed(with_torque(case, 1, size * np.sin(2 * np.pi * 3.3 * case.log.t)))
    assert found.verdict is Verdict.UNEXPLAINED, str(found)
    (said,) = [u for u in found.unexplained if "tone" in u.signature]
    assert said.joint == case.robot.joint_names[1]
    assert abs(float(said.signature.split()[-2]) - 3.3) < 0.1


def test_slow_knocks_are_seen_beneath_fast_noise(arm: tuple[ident.Robot, dict[str, Array]], nothing_missing: list[Case]) -> None:
    case = nothing_missing[1]
    rng, t = np.random.default_rng(5), case.log.t
    level = 1.2 * float(arm[1]["Fc"][1]) * 50.0 * rng.choice([-1.0, 1.0], 9)
    at = t[-1] * (np.arange(9) + 0.5 + rng.uniform(-0.3, 0.3, 9)) / 9.0
    found = diagnosed(with_torque(case, 1, (level * np.exp(-0.5 * ((t[:, None] - at) / 0.1) ** 2)).sum(axis=1)))
    assert found.verdict is Verdict.UNEXPLAINED, str(found)
    assert case.robot.joint_names[1] in {u.joint for u in found.unexplained}


def test_a_name_gives_way_to_a_law_of_another_quantity_and_not_where_it_is_right(nothing_missing: list[Case]) -> None:
    case = nothing_missing[0]
    joint, names = case.robot.joint_names[1], ("offset", "asymmetric_viscous")
    size = 0.5 * float(np.std(next(iter(case.log.tau.values()))[:, 1]))
    other = np.gradient(case.log.q[:, 0], case.log.t)  # type: ignore[index]
    crosstalk = with_torque(case, 1, 4.0 * size * other / np.abs(other).max())
    drift = with_torque(case, 1, size * case.log.t / case.log.t[-1])
    for name in names:
        effect = ident.make_effect(name, joints=[joint], label="+")
        assert outdone(searched(crosstalk, effect), joint)
    assert not outdone(searched(drift, ident.make_effect("offset_drift", joints=[joint], label="+")), joint)


def test_of_a_constant_torque_the_constant_is_named_and_nothing_that_holds_one(nothing_missing: list[Case]) -> None:
    case = nothing_missing[1]
    size = 0.5 * float(np.std(next(iter(case.log.tau.values()))[:, 1]))
    state = searched(with_torque(case, 1, np.full(len(case.log.t), size)))
    found = candidates.best(state, set())
    assert found is not None
    assert (found[0].name, found[1]) == ("offset", (case.robot.joint_names[1],))
    # The same where only what holds a constant, and bends, is looked at first.
    kept = candidates._candidates
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candidates, "_candidates", lambda s, refused: [g for g in kept(s, refused) if g.name == "linear_spring"])
        found = candidates.best(state, set())
    assert found is not None
    assert found[0].name == "offset"


def test_bursts_stand_out_against_what_the_rest_of_the_time_has(nothing_missing: list[Case]) -> None:
    """One; and a few of which each makes the others likely, which are most of all that is left."""
    case = nothing_missing[0]
    t = case.log.t
    std = float(np.std(next(iter(case.log.tau.values()))[:, 1]))
    for size, places in ((0.0, ()), (3.0, (0.4,)), (100.0, (0.2, 0.45, 0.8))):
        level = sum((np.exp(-0.5 * ((t - place * t[-1]) / 0.3) ** 2) for place in places), np.zeros(len(t)))
        state = searched(with_torque(case, 1, size * std * level * np.sin(2 * np.pi * 5.0 * t)))
        assert (burst(state.fit, state.frame) is not None) is bool(places), places


def test_what_acts_is_there_once_and_what_does_not_is_not(arm: tuple[ident.Robot, dict[str, Array]]) -> None:
    robot, drive = arm
    effect = ident.make_effect("offset", joints=[robot.joint_names[1]], label="+")
    (case,) = cases(arm, [(effect, np.array([0.8 * float(drive["Fc"][1])]))], [111])
    held = ident.ZeroPhase()(case.held, robot)
    model = case.model + effect
    without, whole = (ident.fit(case.log, robot, model=m, held=0) for m in (case.model, model))
    share, std = presence(without, whole, held)
    assert abs(share - 1.0) < max(4.0 * std, 0.1)
    # Data in which nothing of it is: what the effect adds taken off the torque.
    tau = held.tau - (without.residual(held) - whole.residual(held))
    share, std = presence(without, whole, replace(held, tau=tau))
    assert abs(share) < max(4.0 * std, 0.1)
