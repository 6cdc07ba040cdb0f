"""What a name must stand up to: a drive's limit, a law at the end of its range, a stop that no spring is, a tone of one speed alone."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from ident.diagnosis import Verdict
from ident.diagnosis.inference.refinement import likeliest
from ident.diagnosis.inference.search import EffectSearch
from ident.friction.presliding import deflection
from tests.pendulum_logs import COULOMB, GRAVITY, INERTIA, RATE, SECONDS, VISCOUS, diagnosed, motion, needed, of, recorded

Array = np.ndarray


def cut_off(seed: int, limit: float) -> ident.LogSet:
    """A loop whose drive gives no more than `limit`, and logs what the controller asks for; integrated at 2 kHz."""
    t, wanted, speed, acceleration = motion(seed)
    h, every = 1.0 / 2000.0, int(2000 / RATE)
    q, v = float(wanted[0]), float(speed[0])
    rng = np.random.default_rng([seed, 2])
    position, asked = np.zeros(t.size), np.zeros(t.size)
    for k in range(t.size * every):
        i, part = divmod(k, every)
        j = min(i + 1, t.size - 1)
        x, dx, ddx = (s[i] + (s[j] - s[i]) * part / every for s in (wanted, speed, acceleration))
        demand = needed(np.array(x), np.array(dx), np.array(ddx)) + 600.0 * (x - q) + 130.0 * (dx - v)
        if part == 0:
            position[i], asked[i] = q, float(demand)
        given = float(np.clip(demand, -limit, limit))
        v += h * (given - GRAVITY * np.sin(q) - VISCOUS * v - COULOMB * np.tanh(v / 1e-3)) / INERTIA
        q += h * v
    return of(seed, t, position + 2e-6 * rng.normal(size=t.size), asked + 0.1 * rng.normal(size=t.size))


def test_a_drive_that_gives_no_more_is_named_with_its_limit() -> None:
    """The torque that moves the arm never exceeds the limit, so that no instrument of the motion foretells what was asked beyond it."""
    _, q, v, acceleration = motion(3)
    limit = float(np.quantile(np.abs(needed(q, v, acceleration)), 0.95))
    found = diagnosed(cut_off(3, limit), cut_off(4, limit))
    (finding,) = found.findings
    assert (finding.name, finding.joints) == ("saturation", ("j1",)), str(found)
    values = {p.name: p.value for p in finding.parameters}
    assert values["limit"] == pytest.approx(limit, rel=0.005)
    assert values["sat_j1"] == pytest.approx(1.0, abs=0.01)


def test_knocks_are_no_limit_of_a_drive() -> None:
    """They drive the torque up as well, but it is no more than anything where they act."""

    def knocks(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        at, size = rng.uniform(2.0, SECONDS - 2.0, 12), 60.0 * rng.choice([-1.0, 1.0], 12)
        return np.asarray((size * np.exp(-0.5 * ((t[:, None] - at) / 0.08) ** 2)).sum(axis=1))

    found = diagnosed(recorded(5, knocks), recorded(6, knocks))
    assert "saturation" not in {f.name for f in found.findings}
    assert found.verdict is Verdict.UNEXPLAINED


def test_a_hose_that_drags_is_no_presliding() -> None:
    """Hysteresis that builds up over a fifth of the travel: friction of bearings and gears does so over far less."""

    def hose(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        z, width = np.zeros(q.size), 0.2 * float(np.ptp(q))
        for k in range(1, q.size):
            z[k] = np.clip(z[k - 1] + 2.0 * (q[k] - q[k - 1]) / width, -1.0, 1.0)
        return 5.0 * z

    found = diagnosed(recorded(7, hose), recorded(8, hose))
    assert "presliding" not in {f.name for f in found.findings}
    assert found.verdict is not Verdict.CLEAN


def test_two_effects_that_undo_each_other_are_none() -> None:
    """Two that share what is there do not, nor do two that are both there."""

    def both(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        return 2.0 * v * np.abs(v) + 1.5

    found = diagnosed(recorded(41, both), recorded(42, both)).decision
    plain = found.fit.with_effects(())

    def named(name: str, label: str = "+", **shape: float) -> ident.Effect:
        effect = ident.make_effect(name, joints=["j1"], label=label)
        return effect.with_shape(**shape) if shape else effect

    def impossible(*effects: ident.Effect) -> tuple[int, ...]:
        state = EffectSearch(plain, found.scores.catalogue, accepted=[(e, ("j1",)) for e in effects])
        state.solve()
        return state.impossible()

    there = named("offset"), named("nonlinear_viscous", a=2.0)
    assert impossible(*there) == ()
    assert impossible(there[0], named("nonlinear_viscous", a=1.9), named("nonlinear_viscous", "++", a=2.1)) == ()
    assert impossible(*there, named("stribeck", v_s=0.3)) == ()
    assert impossible(*there, named("stribeck", v_s=0.3), named("stribeck", "++", v_s=0.33)) == (2, 3)


@pytest.mark.parametrize("start", [0.2, 0.3])
def test_a_shape_climbs_out_of_its_own_noise(start: float) -> None:
    """At the noise that a wrong distance leaves that very distance scores best, far around."""
    distance = 0.1

    def building_up(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        return COULOMB * (deflection(q, distance) - np.sign(v))

    fit = diagnosed(recorded(31, building_up), recorded(32, building_up)).decision.fit.with_effects(())
    wrong = ident.make_effect("presliding", joints=["j1"], label="+").with_shape(z_s=start)
    found = likeliest([wrong], ("j1",), (), fit, fit.with_effects((wrong,)).solved(2))
    assert found.z_s == pytest.approx(distance, rel=0.02)


def test_a_stop_is_no_spring() -> None:
    """A cubic follows what a stop does in part; a function that is smooth leaves less than half of what is left, and is told instead."""

    def stop(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        edge = float(np.quantile(q, 0.7))
        return 8.0 * np.maximum(q - edge, 0.0)

    found = diagnosed(recorded(9, stop), recorded(9, stop))
    assert found.verdict is Verdict.UNEXPLAINED, str(found)
    assert not any(f.confidence > 0.5 for f in found.findings)


@pytest.mark.parametrize("only_fast", [False, True])
def test_a_tone_knows_no_speed(only_fast: bool) -> None:
    """A hum is there at any speed; a line that only the fast half of the log has is an encoder's counts, or a wheel's."""

    def hum(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        there = np.abs(v) > np.median(np.abs(v)) if only_fast else np.ones(t.size)
        return 0.15 * np.sin(2 * np.pi * 6.3 * t) * there

    found = diagnosed(recorded(11, hum), recorded(12, hum))
    said = " ".join(u.evidence for u in found.unexplained)
    assert ("a tone of 6." in said) is not only_fast


def test_noise_that_is_loud_where_an_effect_is_large_widens_its_interval() -> None:
    """The same noise, once the same all along, once in proportion to what the effect does."""

    def noise(uneven: bool):  # type: ignore[no-untyped-def]
        def more(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
            return 2.0 * rng.normal(size=t.size) * (v**2 / np.sqrt(np.mean(v**4)) if uneven else 1.0)

        return more

    std = []
    for uneven in (False, True):
        train, held = recorded(13, noise(uneven)), recorded(14, noise(uneven))
        before = ident.fit(train, model=[ident.make_effect("coulomb")], held=0)
        prepare = ident.ZeroPhase(cutoff_hz=8.0)
        found = ident.diagnose(before, prepare(held), fit=prepare(train))
        (finding,) = [f for f in found.findings if f.name == "viscous"]
        std.append(finding.parameters[0].std)
    assert std[1] > 1.2 * std[0], std


def test_a_leftover_of_position_and_of_speed_is_described_by_two_laws() -> None:
    """Their parameters once had one name, which ended the diagnosis with an error."""

    def both(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        fast = float(np.quantile(np.abs(v), 0.6))
        return 8.0 * np.maximum(q - float(np.quantile(q, 0.6)), 0.0) + 4.0 * np.sin(6.0 * v) * (np.abs(v) < fast)

    found = diagnosed(recorded(17, both), recorded(18, both))
    assert found.verdict is Verdict.UNEXPLAINED


def test_a_drift_is_no_smooth_law_of_time_alone() -> None:
    """Coulomb friction that warms up is named, although a spline of time does all that it does."""

    def warming(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        return 5.0 * np.exp(-t / 35.0) * np.sign(v)

    found = diagnosed(recorded(15, warming), recorded(16, warming))
    assert "temperature_drift_coulomb" in {f.name for f in found.findings}, str(found)


def test_a_lag_is_told_at_the_time_that_its_own_values_tell() -> None:
    """To first order another time constant scores best, of which no reading would have the share that is found."""
    lag = 0.15

    def lagged(seed: int) -> ident.LogSet:
        t, q, v, acceleration = motion(seed)
        rng = np.random.default_rng([seed, 1])
        tau = needed(q, v, acceleration)
        behind = np.empty_like(tau)
        behind[0] = tau[0]
        keep = np.exp(-1.0 / (RATE * lag))
        for k in range(1, tau.size):  # mean of both ends over the step
            behind[k] = keep * behind[k - 1] + (1.0 - keep) * 0.5 * (tau[k] + tau[k - 1])
        return of(seed, t, q + 2e-6 * rng.normal(size=t.size), behind + 0.3 * rng.normal(size=t.size))

    found = diagnosed(lagged(21), lagged(22))
    assert found.verdict is Verdict.EXPLAINED, str(found)
    (finding,) = found.findings
    time, own = (next(p for p in finding.parameters if p.name == name) for name in ("T", "lag_j1"))
    assert finding.name == "filter_lag"
    assert abs(time.value - lag) < 3.0 * time.std
    assert abs(own.value - time.value) < 0.5 * own.std
    # A time that is off makes its own share wrong as well, by a slope: where the two agree moves by 1 / (1 - slope) times as much.
    shares: list[float] = []
    for at in (0.98 * time.value, 1.02 * time.value):
        fit = found.decision.fit.with_effects((finding.effect.with_shape(T=at),))
        shares.append(float(fit.solved(3).theta[-1]))
    slope = (shares[1] - shares[0]) / (0.04 * time.value)
    assert time.std == pytest.approx(own.std / (1.0 - slope), rel=0.2)


@pytest.mark.parametrize(("at", "mass"), [(17.87, 3.0), (25.3, 1.0)])
def test_a_payload_is_picked_up_when_it_is(at: float, mass: float) -> None:
    """What a wrong moment leaves passes for slow noise, at which that very moment scores best."""

    def payload(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        return np.asarray((t >= at) * mass * (0.25 * np.gradient(v, t) + 9.81 * 0.5 * np.sin(q)))

    found = diagnosed(recorded(23, payload), recorded(24, payload))
    (finding,) = found.findings
    moment = next(p for p in finding.parameters if p.name == "t_0")
    assert finding.name == "payload_step"
    assert abs(moment.value - at) < 0.02, str(found)


def test_what_is_named_is_not_said_to_be_undetectable() -> None:
    found = diagnosed(*(recorded(seed, lambda rng, t, q, v: np.full(t.size, 3.0)) for seed in (33, 34)))
    named = {(f.name, f.joints) for f in found.findings}
    assert named == {("offset", ("j1",))}
    assert not named & {(h.effect, h.joints) for h in found.hidden}


def test_a_moment_is_known_to_no_less_than_a_sample() -> None:
    found = diagnosed(recorded(33, lambda rng, t, q, v: np.where(t > 26.0, 300.0, 0.0)), recorded(34, lambda rng, t, q, v: 0.0 * t))
    (finding,) = [f for f in found.findings if f.name == "offset_step"]
    moment = next(p for p in finding.parameters if p.name == "t_0")
    assert moment.std >= 1.0 / RATE / np.sqrt(12.0)


def test_a_winding_that_warms_in_seconds_is_no_spring() -> None:
    def warming(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        return np.asarray(1.5 * np.exp(-t / 12.0) * np.sign(v))

    found = diagnosed(recorded(27, warming), recorded(28, warming))
    (finding,) = found.findings
    (constant,) = [p.value for p in finding.parameters if p.name == "T"]
    assert finding.name == "temperature_drift_coulomb", str(found)
    assert constant == pytest.approx(12.0, rel=0.1)


def test_what_one_stretch_alone_shows_is_told_and_names_nothing() -> None:
    """A brake that drags for two and a half seconds of forty: the whole log speaks of it, and without those seconds nothing does."""

    def brake(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        return 2.0 * np.sign(v) * ((t > 20.0) & (t < 22.5))

    found = diagnosed(recorded(25, brake), recorded(26, brake))
    assert found.verdict is Verdict.UNEXPLAINED, str(found)
    assert not found.findings
    assert any("one stretch" in u.evidence for u in found.unexplained)


def test_terms_of_a_series_are_no_causes() -> None:
    """Rubber beyond an angle: a cubic and four waves follow it together, which one smooth function does as well."""

    def rubber(rng: np.random.Generator, t: Array, q: Array, v: Array) -> Array:
        return np.asarray(30.0 * np.maximum(q - np.quantile(q, 0.85), 0.0) ** 1.5)

    found = diagnosed(recorded(31, rubber), recorded(31, rubber))
    assert found.verdict is Verdict.UNEXPLAINED, str(found)
    assert not found.findings
    assert found.description is not None
    assert found.description.comparison.error_after.relative_all < 0.5 * found.comparison.error_before.relative_all
