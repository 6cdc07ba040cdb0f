"""Signals from synthetic motion that is known exactly: derivatives, time stamps, gaps, masks, and both sides of the equation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ident.auditing import audit
from ident.errors import ConfigurationError, DataError
from ident.logs.log import Log, LogSet
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission
from ident.signals import (
    CentralDifference,
    Preparation,
    Recorded,
    SavitzkyGolay,
    Signals,
    Standstill,
    ZeroPhase,
    make_preparation,
    preparation_names,
)

Array = np.ndarray
URDF = """<robot name="pair"><link name="a"/><link name="b"/><link name="c"/>
<joint name="turn" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/></joint></robot>"""


def robot(transmission: Transmission | None = None) -> Robot:
    return Robot.from_urdf(URDF, transmission=transmission)


@dataclass(frozen=True)
class Truth:
    """Two sums of sines, and a torque that is exactly linear in velocity, acceleration, speed's sign and one."""

    seed: int = 0
    highest: float = 1.5
    parameters: tuple[float, ...] = (0.8, 1.5, 2.0, 0.3)

    def _terms(self) -> tuple[Array, Array, Array]:
        rng = np.random.default_rng(self.seed)
        f = rng.uniform(0.2, self.highest, (4, 2))
        return f, rng.standard_normal((4, 2)) / f, rng.uniform(0, 6, (4, 2))

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        f, amplitude, phase = self._terms()
        w = 2 * np.pi * f
        angle = w * t[:, None, None] + phase
        sines, cosines = amplitude * np.sin(angle), amplitude * np.cos(angle)
        return sines.sum(1), (w * cosines).sum(1), -(w**2 * sines).sum(1)

    def torque(self, t: Array) -> Array:
        _, v, a = self.at(t)
        inertia, viscous, coulomb, offset = self.parameters
        return inertia * a + viscous * v + coulomb * np.sign(v) + offset

    def log(self, t: Array, name: str = "run", noise: float = 0.0, step: float = 0.0, torque_noise: float = 0.0) -> Log:
        rng = np.random.default_rng(self.seed + 99)
        q = self.at(t)[0] + noise * rng.standard_normal((len(t), 2))
        if step:
            q = np.round(q / step) * step
        tau = self.torque(t) + torque_noise * rng.standard_normal((len(t), 2))
        return Log(name, t, q, tau={"joint": tau})


def clock(kind: str, rate: float, duration: float, seed: int = 3) -> Array:
    """Time stamps: even, jittering, with dropped samples, or starting far from zero."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(duration * rate)) / rate
    if kind == "jitter":
        t = t + rng.uniform(-0.3, 0.3, len(t)) / rate
    elif kind == "wild":
        t = np.cumsum(np.maximum(rng.gamma(4, 0.25, len(t)), 0.3)) / rate
    elif kind == "dropped":
        t = t[rng.random(len(t)) > 0.05]
    elif kind == "epoch":
        t = t + 1.7e9
    return t


def errors(signals: Signals, truth: Truth) -> tuple[float, float, float]:
    """Relative rms error of position, velocity, acceleration over both joints."""
    exact = truth.at(signals.t)
    found = (signals.q, signals.dq, signals.ddq)
    return tuple(float(np.sqrt(np.mean((f - e) ** 2) / np.mean(e**2))) for f, e in zip(found, exact, strict=True))  # type: ignore[return-value]


@pytest.mark.parametrize("kind", ["even", "jitter", "wild", "dropped", "epoch"])
def test_derivatives_of_a_clean_motion(kind: str) -> None:
    truth = Truth()
    signals = ZeroPhase(cutoff_hz=15)(truth.log(clock(kind, 500.0, 20.0)), robot())
    assert max(errors(signals, truth)) < 5e-5


def test_wrong_time_would_be_seen() -> None:
    """Believing that irregular samples are even is a thousand times worse: the test above can tell."""
    truth = Truth()
    t = clock("wild", 500.0, 20.0)
    log = truth.log(t)
    pretended = replace(log, t=np.linspace(t[0], t[-1], len(t)))
    assert errors(ZeroPhase(cutoff_hz=15)(pretended, robot()), truth)[1] > 0.01


@pytest.mark.parametrize("prep", [ZeroPhase(cutoff_hz=12), SavitzkyGolay(cutoff_hz=12), CentralDifference()])
@pytest.mark.parametrize("kind", ["even", "jitter"])
def test_no_strategy_shifts_time(prep: Preparation, kind: str) -> None:
    """Velocity and acceleration are projected on the exact ones' time derivative: a delay would show as a component along it."""
    truth = Truth(seed=5)
    signals = prep(truth.log(clock(kind, 400.0, 20.0)), robot())
    h = 1e-4
    for found, order in ((signals.q, 0), (signals.dq, 1), (signals.ddq, 2)):
        ahead, behind = (truth.at(signals.t + s)[order] for s in (h, -h))
        slope = (ahead - behind) / (2 * h)
        delay = -np.sum((found - truth.at(signals.t)[order]) * slope) / np.sum(slope**2)
        assert abs(delay) < 2e-5, f"{delay} s of the derivative of order {order}"


def test_noise_and_quantisation_are_bounded() -> None:
    """The error in acceleration stays at what the noise within the pass band must leave: sqrt(2 s²/rate (2π)⁴ f⁵/5)."""
    truth, rate, noise, cutoff = Truth(seed=2), 1000.0, 1e-4, 15.0
    signals = ZeroPhase(cutoff_hz=cutoff)(truth.log(clock("even", rate, 30.0), noise=noise), robot())
    expected = np.sqrt(2 * noise**2 / rate * (2 * np.pi) ** 4 * cutoff**5 / 5)
    actual = np.sqrt(np.mean((signals.ddq - truth.at(signals.t)[2]) ** 2))
    assert 0.5 * expected < actual < 1.2 * expected
    coarse = ZeroPhase(cutoff_hz=cutoff)(truth.log(clock("even", rate, 30.0), step=noise * np.sqrt(12)), robot())
    assert np.sqrt(np.mean((coarse.ddq - truth.at(coarse.t)[2]) ** 2)) < 2 * expected


class TestChosenCutoff:
    @pytest.mark.parametrize("rate", [100.0, 1000.0, 5000.0])
    @pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-4])
    def test_lies_above_the_motion_and_keeps_noise_small(self, rate: float, noise: float) -> None:
        truth = Truth(seed=4)
        signals = ZeroPhase()(truth.log(clock("even", rate, 30.0), noise=noise), robot())
        assert signals.report.cutoff_hz > truth.highest
        assert errors(signals, truth)[2] < 0.04

    def test_falls_with_noise(self) -> None:
        truth = Truth(seed=4)
        chosen = [ZeroPhase()(truth.log(clock("even", 1000.0, 30.0), noise=n), robot()).report.cutoff_hz for n in (1e-5, 1e-3, 1e-2)]
        assert chosen[0] >= chosen[1] > chosen[2]

    def test_sees_noise_that_a_drive_has_filtered(self) -> None:
        """White noise is absent at high frequency; judged there alone, everything would look clean."""
        from ident.signals.filters import zero_phase_lowpass

        truth, rate = Truth(seed=6), 1000.0
        t = clock("even", rate, 30.0)
        noise = zero_phase_lowpass(np.random.default_rng(0).standard_normal((len(t), 2)), 60.0, rate) * 1e-3
        log = Log("run", t, truth.at(t)[0] + noise, tau={"joint": truth.torque(t)})
        signals = ZeroPhase()(log, robot())
        assert errors(signals, truth)[2] < 0.05

    def test_is_reported(self) -> None:
        report = ZeroPhase()(Truth().log(clock("even", 500.0, 30.0), noise=1e-5), robot()).report
        assert f"{report.cutoff_hz:.3g} Hz" in report.text()
        assert report.cutoff_reason
        assert report.joints[0].noise == pytest.approx(1e-5, rel=0.1)
        asked = ZeroPhase(cutoff_hz=9)(Truth().log(clock("even", 500.0, 30.0)), robot()).report
        assert "as asked" in asked.cutoff_reason

    def test_a_weak_joint_does_not_decide_for_all(self) -> None:
        truth = Truth()
        t = clock("even", 500.0, 30.0)
        log = truth.log(t, noise=1e-5)
        shaking = np.column_stack([log.q[:, 0], 2e-5 * np.random.default_rng(0).standard_normal(len(t))])
        both = ZeroPhase()(log, robot()).report.cutoff_hz
        assert ZeroPhase()(replace(log, q=shaking), robot()).report.cutoff_hz > 0.5 * both


class TestGaps:
    def log(self) -> tuple[Truth, Log]:
        truth = Truth(seed=1)
        t = clock("even", 200.0, 40.0)
        return truth, truth.log(t[(t < 15.0) | (t > 15.6)], torque_noise=0.0)

    def test_nothing_is_interpolated_across(self) -> None:
        truth, log = self.log()
        signals = ZeroPhase(cutoff_hz=8)(log, robot())
        assert len(signals.runs) == 2
        assert signals.run_names == ("run [1]", "run [2]")
        assert not np.any((signals.t > 15.0) & (signals.t < 15.6))
        assert max(errors(signals, truth)) < 1e-4
        assert "1 gap" in signals.report.resampled

    def test_short_ones_are_bridged_if_the_cutoff_allows(self) -> None:
        truth = Truth(seed=1)
        t = clock("even", 1000.0, 20.0)
        t = t[(t < 10.0) | (t > 10.008)]
        slow, fast = (ZeroPhase(cutoff_hz=c)(truth.log(t), robot()) for c in (8, 60))
        assert len(slow.runs) == 1
        assert max(errors(slow, truth)) < 1e-4
        assert len(fast.runs) == 2

    def test_of_no_use_where_everything_is_gaps(self) -> None:
        truth = Truth()
        t = np.concatenate([k * 1.0 + np.arange(20) * 0.005 for k in range(30)])
        with pytest.raises(DataError, match="too few to differentiate"):
            ZeroPhase(cutoff_hz=8)(truth.log(t), robot())


class TestBothSides:
    """The equation holds on the rows: filtered columns times true parameters give the filtered torque."""

    @staticmethod
    def columns(signals: Signals) -> Array:
        ones = np.ones_like(signals.dq)
        return np.stack([signals.ddq, signals.dq, np.sign(signals.dq), ones], axis=2)

    @pytest.mark.parametrize(
        ("prep", "tolerance"),
        [
            (ZeroPhase(cutoff_hz=20), 2e-4),
            (ZeroPhase(), 2e-4),
            (ZeroPhase(cutoff_hz=20, decimate=5), 2e-4),
            (ZeroPhase(cutoff_hz=20, decimate=False), 5e-2),
            (ZeroPhase(cutoff_hz=20, decimate=False, row_cutoff_hz=8), 2e-4),
            (SavitzkyGolay(cutoff_hz=20), 2e-3),
            (CentralDifference(), 1e-3),
            (CentralDifference(decimate=True, cutoff_hz=20), 1e-3),
        ],
    )
    def test_parameters_come_back(self, prep: Preparation, tolerance: float) -> None:
        truth = Truth(seed=7)
        signals = prep(truth.log(clock("even", 500.0, 40.0)), robot())
        rows = signals.filtered(self.columns(signals))
        use = signals.valid
        solution = np.linalg.lstsq(rows[use], signals.tau[use], rcond=None)[0]
        np.testing.assert_allclose(solution, truth.parameters, rtol=tolerance, atol=tolerance)

    def test_row_times(self) -> None:
        """A torque that is time itself tells at which time each row stands."""
        truth = Truth()
        t = clock("jitter", 300.0, 30.0)
        log = replace(truth.log(t), tau={"joint": np.column_stack([t, 2 * t])})
        signals = ZeroPhase(cutoff_hz=10)(log, robot())
        np.testing.assert_allclose(signals.tau[:, 0], signals.row_time, atol=1e-9)
        np.testing.assert_allclose(np.diff(signals.row_time), 1 / signals.row_rate, rtol=1e-9)

    def test_pieces_equal_the_whole(self) -> None:
        truth = Truth()
        logs = LogSet((truth.log(clock("even", 300.0, 30.0), "a"), truth.log(clock("even", 300.0, 11.0), "b")), robot())
        signals = ZeroPhase(cutoff_hz=10)(logs)
        columns = self.columns(signals)
        whole = signals.filtered(columns)
        assert len(whole) == len(signals.tau)
        for samples in (1, 100, 777, 5000, None):
            seen = np.zeros(len(signals.tau), int)
            for block in signals.blocks(samples):
                rows = block.reduce(columns[block.samples])
                np.testing.assert_allclose(rows, whole[block.rows], atol=1e-11)
                seen[block.rows] += 1
                run = signals.runs[block.run]
                assert run.start <= block.samples.start
                assert block.samples.stop <= run.stop
            assert (seen == 1).all()

    def test_selected_rows_are_the_same_rows(self) -> None:
        truth = Truth()
        signals = ZeroPhase(cutoff_hz=10)(truth.log(clock("even", 300.0, 60.0)), robot())
        part = signals.select_rows([slice(10, 30), slice(100, 140)])
        whole = signals.filtered(self.columns(signals))
        np.testing.assert_allclose(part.filtered(self.columns(part)), np.concatenate([whole[10:30], whole[100:140]]), atol=1e-11)
        np.testing.assert_array_equal(part.row_time, np.concatenate([signals.row_time[10:30], signals.row_time[100:140]]))
        with pytest.raises(ConfigurationError, match="within one run"):
            signals.select_rows([slice(0, len(signals.tau) + 1)])

    @pytest.mark.parametrize("by", ["fraction", "blocks"])
    def test_split_shares_no_sample(self, by: str) -> None:
        signals = ZeroPhase(cutoff_hz=10)(Truth().log(clock("even", 300.0, 60.0)), robot())
        fit, held = signals.split(by=by, held=0.25)
        assert not set(fit.t.tolist()) & set(held.t.tolist())
        assert 0.1 < len(held.tau) / len(signals.tau) < 0.3

    def test_runs_by_name(self) -> None:
        truth = Truth()
        logs = LogSet(tuple(truth.log(clock("even", 300.0, 12.0), name) for name in "abc"), robot())
        signals = ZeroPhase(cutoff_hz=10)(logs)
        assert signals.select_runs(["c", 0]).run_names == ("a", "c")
        fit, held = signals.split(by="run", held=0.3)
        assert sorted((*fit.run_names, *held.run_names)) == ["a", "b", "c"]
        with pytest.raises(ConfigurationError, match="unknown run"):
            signals.select_runs(["d"])


class TestMasks:
    def rests(self, seed: int = 0) -> tuple[Log, Array]:
        """Moves with rests between them; at rest dry friction takes any value. Returns the log and the truth (inertia, viscous, dry)."""
        rng = np.random.default_rng(seed)
        rate, position, q, tau = 500.0, 0.0, [], []
        for _ in range(30):
            seconds, stroke = rng.uniform(0.5, 1.2), rng.uniform(0.4, 1.0) * rng.choice([-1, 1])
            s = np.arange(int(seconds * rate)) / (seconds * rate)
            q.append(position + stroke * (10 * s**3 - 15 * s**4 + 6 * s**5))
            v = stroke * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds
            a = stroke * (60 * s - 180 * s**2 + 120 * s**3) / seconds**2
            tau.append(0.8 * a + 1.5 * v + 4.0 * np.sign(stroke) * (s > 0))
            position += stroke
            rest = int(rng.uniform(0.2, 0.8) * rate)
            q.append(np.full(rest, position))
            tau.append(np.full(rest, rng.uniform(-3.9, 3.9)))
        q_all, tau_all = np.concatenate(q), np.concatenate(tau)
        t = np.arange(len(q_all)) / rate
        q_all = np.round(q_all / 1e-5) * 1e-5
        return Log("rests", t, np.column_stack([q_all, q_all]), tau={"joint": np.column_stack([tau_all, tau_all])}), np.array(
            [0.8, 1.5, 4.0]
        )

    def solve(self, rule: Standstill | None) -> Array:
        log, _ = self.rests()
        signals = ZeroPhase(cutoff_hz=25, standstill=rule)(log, robot())
        columns = signals.filtered(np.stack([signals.ddq, signals.dq, np.sign(signals.dq)], axis=2))
        return np.linalg.lstsq(columns[signals.valid], signals.tau[signals.valid], rcond=None)[0]

    def test_dry_friction_is_not_biased_by_rest(self) -> None:
        _, truth = self.rests()
        np.testing.assert_allclose(self.solve(Standstill()), truth, rtol=0.005)
        assert np.abs(self.solve(None) / truth - 1).max() > 0.02, "keeping the rests does harm, or this test shows nothing"

    def test_enough_rows_are_kept_where_reversals_are_close(self) -> None:
        """Rows of a low cut-off nearly all reach a reversal; dropping them all would leave nothing."""
        t = clock("even", 300.0, 60.0)
        q = np.column_stack([np.sin(2 * np.pi * 2.0 * t), np.sin(2 * np.pi * 2.3 * t)])
        log = Log("run", t, q, tau={"joint": np.cos(2 * np.pi * 2.0 * t)[:, None] * [1.0, 1.0]})
        strict = ZeroPhase(cutoff_hz=8, standstill=Standstill(fraction=0.1, share=0.02, keep=0.0))(log, robot())
        default = ZeroPhase(cutoff_hz=8, standstill=Standstill(fraction=0.1, share=0.02))(log, robot())
        assert strict.valid.mean() < 0.25
        assert default.valid.mean() > 0.45
        assert any("reversals are closely spaced" in w for w in default.report.warnings)
        quick = ZeroPhase(cutoff_hz=60)(log, robot())
        assert not any("reversals" in w for w in quick.report.warnings)

    def test_absolute_speed(self) -> None:
        log, _ = self.rests()
        report = ZeroPhase(cutoff_hz=25, standstill=Standstill(speed=(0.2, 0.4)))(log, robot()).report
        assert [j.threshold for j in report.joints] == [0.2, 0.4]
        assert report.joints[1].rows < report.joints[0].rows

    def test_measured_side_decides(self) -> None:
        """Motor 2 turns with both joints: it moves while joint 2 stands still."""
        K = np.linalg.inv(np.array([[50.0, 0.0], [30.0, 40.0]]))
        truth = Truth()
        t = clock("even", 300.0, 30.0)
        q = truth.at(t)[0]
        q[:, 1] = 0.1
        log = Log("run", t, q, tau={"motor": np.ones((len(t), 2))})
        on_motor = ZeroPhase(cutoff_hz=8)(log, robot(Transmission(K, None, Side.MOTOR)))
        assert on_motor.valid[:, 1].mean() >= 0.45
        on_joint = ZeroPhase(cutoff_hz=8)(log, robot(Transmission(K, None, Side.JOINT)))
        assert not on_joint.valid[:, 1].any()
        assert any("never moved: slide" in w for w in on_joint.report.warnings)

    def test_missing_torque_masks_its_rows_only(self) -> None:
        truth = Truth()
        log = truth.log(clock("even", 300.0, 60.0))
        tau = log.tau["joint"].copy()
        tau[3000:3050, 0] = np.nan
        tau[3050:3100, 0] = np.inf
        whole = ZeroPhase(cutoff_hz=8)(log, robot())
        holed = ZeroPhase(cutoff_hz=8)(replace(log, tau={"joint": tau}), robot())
        touched = (holed.row_time > log.t[2900]) & (holed.row_time < log.t[3200])
        assert not holed.valid[(holed.row_time > log.t[3000]) & (holed.row_time < log.t[3099]), 0].any()
        np.testing.assert_array_equal(holed.valid[~touched], whole.valid[~touched])
        np.testing.assert_allclose(holed.tau[~touched & holed.valid[:, 0], 0], whole.tau[~touched & whole.valid[:, 0], 0], atol=1e-9)
        np.testing.assert_array_equal(holed.valid[:, 1], whole.valid[:, 1])
        assert holed.report.joints[0].lost["torque missing"] > 0

    def test_joint_without_torque(self) -> None:
        log = Truth().log(clock("jitter", 300.0, 30.0))
        tau = log.tau["joint"].copy()
        tau[:, 1] = np.nan
        signals = ZeroPhase(cutoff_hz=8)(replace(log, tau={"joint": tau}), robot())
        assert signals.valid[:, 0].any()
        assert not signals.valid[:, 1].any()
        assert np.isnan(signals.tau[:, 1]).all()
        assert any("no torque of slide" in w for w in signals.report.warnings)

    def test_torque_that_never_changes_is_taken_as_not_logged(self) -> None:
        log = Truth().log(clock("even", 300.0, 30.0))
        tau = log.tau["joint"].copy()
        tau[:, 1] = 0.0
        signals = ZeroPhase(cutoff_hz=8)(replace(log, tau={"joint": tau}), robot())
        assert signals.valid[:, 0].any()
        assert not signals.valid[:, 1].any()
        assert any("torque never changes while the joint moves: slide (at 0)" in w for w in signals.report.warnings)
        still = np.where([False, True], 0.1 + 1e-4 * (np.arange(len(log)) % 3 == 0)[:, None], log.q)
        resting = ZeroPhase(cutoff_hz=8)(replace(log, q=still, tau={"joint": tau}), robot())
        assert not any("never changes" in w for w in resting.report.warnings)
        off = ZeroPhase(cutoff_hz=8)(replace(log, tau={"joint": 0 * tau}), robot())
        assert off.valid.any(axis=0).all()  # a robot that swings freely

    @pytest.mark.parametrize("kind", ["even", "jitter", "wild", "dropped"])
    def test_saturated_torque(self, kind: str) -> None:
        """Also where the log is resampled: a spline through a plateau swings beyond it."""
        log = Truth(seed=3).log(clock(kind, 300.0, 60.0), torque_noise=0.01)
        limit = float(np.percentile(np.abs(log.tau["joint"][:, 0]), 90))
        tau = np.clip(log.tau["joint"], [-limit, -np.inf], [limit, np.inf])
        cut = replace(log, tau={"joint": tau})
        masked, kept = (ZeroPhase(cutoff_hz=20, saturated=s)(cut, robot()) for s in ("mask", "keep"))
        assert masked.report.joints[0].lost["torque at its limit"] > 0
        assert masked.report.joints[1].lost["torque at its limit"] == 0
        assert masked.valid[:, 0].sum() < kept.valid[:, 0].sum()
        assert any(f"stays at its extreme (-{limit:.4g} and {limit:.4g})" in w for w in masked.report.warnings), masked.report.warnings
        # A tenth of the samples is at the limit, and rows that rest on them are about as many, or more.
        assert masked.report.joints[0].lost["torque at its limit"] > 0.08 * len(kept.tau)

    def test_no_motion_at_all(self) -> None:
        t = clock("even", 300.0, 30.0)
        still = Log("still", t, np.tile([0.3, 0.1], (len(t), 1)), tau={"joint": np.ones((len(t), 2))})
        with pytest.raises(DataError, match="no joint moves"):
            ZeroPhase(cutoff_hz=8)(still, robot())
        assert ZeroPhase(cutoff_hz=8, standstill=None)(still, robot()).valid.all()

    def test_flicker_of_the_encoder_is_no_motion(self) -> None:
        t = clock("even", 300.0, 30.0)
        truth = Truth()
        flicker = 1e-4 * np.random.default_rng(0).integers(0, 2, len(t))
        log = Log("run", t, np.column_stack([truth.at(t)[0][:, 0], flicker]), tau={"joint": np.ones((len(t), 2))})
        signals = ZeroPhase(cutoff_hz=8)(log, robot())
        assert not signals.valid[:, 1].any()


def test_recorded_derivatives_pass_untouched() -> None:
    truth = Truth()
    t = clock("even", 200.0, 10.0)
    q, v, a = truth.at(t)
    log = Log("run", t, q, dq=v, ddq=a, tau={"joint": truth.torque(t)})
    signals = Recorded(standstill=None)(log, robot())
    np.testing.assert_array_equal(signals.ddq, a)
    np.testing.assert_array_equal(signals.tau, truth.torque(t))
    assert signals.valid.all()
    with pytest.raises(DataError, match="ddq1"):
        Recorded()(replace(log, ddq=None), robot())


def test_recorded_velocities() -> None:
    truth = Truth()
    t = clock("even", 500.0, 20.0)
    q, v, _ = truth.at(t)
    log = Log("run", t, np.round(q, 2), dq=v, tau={"joint": truth.torque(t)})
    assert errors(ZeroPhase(cutoff_hz=15, velocity="recorded")(log, robot()), truth)[2] < 1e-5
    with pytest.raises(DataError, match="dq1"):
        ZeroPhase(cutoff_hz=15, velocity="recorded")(replace(log, dq=None), robot())


def test_runs_of_other_rates_and_starts_are_brought_together() -> None:
    truth = Truth()
    logs = LogSet(
        (truth.log(clock("even", 500.0, 10.0), "a"), truth.log(clock("epoch", 400.0, 12.0), "b"), truth.log(clock("even", 500.0, 9.0), "c"))
    )
    signals = ZeroPhase(cutoff_hz=15)(logs, robot())
    assert signals.rate == pytest.approx(500.0)
    assert max(errors(signals, truth)) < 2e-5
    assert ZeroPhase(cutoff_hz=15, resample_hz=250)(logs, robot()).rate == 250


def test_wrapped_angles_are_joined() -> None:
    t = clock("even", 300.0, 20.0)
    angle = 4 * np.sin(0.8 * t)
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    log = Log("run", t, np.column_stack([wrapped, 0.1 * np.sin(t)]), tau={"joint": np.ones((len(t), 2))})
    signals = ZeroPhase(cutoff_hz=10)(log, robot())
    np.testing.assert_allclose(signals.dq[:, 0], 3.2 * np.cos(0.8 * signals.t), atol=1e-3)
    assert any("full turn" in w for w in signals.report.warnings)


def test_the_report_tells_missing_samples_from_jitter() -> None:
    t = clock("dropped", 500.0, 20.0)
    text = ZeroPhase(cutoff_hz=12)(Truth().log(t), robot()).report.resampled
    k = np.diff(np.rint(t * 500))
    assert f"resampled to 500 Hz ({int((k[k < 3.5] - 1).sum())} samples missing)" in text
    text = ZeroPhase(cutoff_hz=12)(Truth().log(clock("jitter", 500.0, 20.0)), robot()).report.resampled
    assert "steps vary by" in text
    assert "missing" not in text


@pytest.mark.parametrize("rate", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("place", [0.1, 0.6, 0.97])
def test_a_single_missing_sample_shifts_nothing(rate: float, place: float) -> None:
    """Stamps that are whole steps of the clock leave no room for rounding to hide a step in."""
    truth = Truth()
    t = np.arange(round(40.0 * rate)) / rate
    t = np.round(np.delete(t, round(place * len(t))), 6)
    whole, holed = (ZeroPhase(cutoff_hz=2.0)(truth.log(x), robot()) for x in (np.round(np.arange(round(40.0 * rate)) / rate, 6), t))
    assert whole.report.resampled.startswith("even")
    assert "1 sample missing" in holed.report.resampled
    for one, other in zip(errors(holed, truth), errors(whole, truth), strict=True):
        assert one < max(3.0 * other, 1e-4)


def test_a_torque_that_is_logged_more_slowly_is_named() -> None:
    """Every row rests on samples without it, and no joint may go without a word."""
    log = Truth().log(clock("even", 500.0, 20.0))
    tau = log.tau["joint"].copy()
    tau[np.arange(len(tau)) % 5 != 0, 1] = np.nan
    report = ZeroPhase(cutoff_hz=12)(replace(log, tau={"joint": tau}), robot()).report
    assert report.joints[1].rows == 0
    (said,) = [w for w in report.warnings if w.startswith(f"no row of {report.joints[1].name} can be used")]
    assert "at a lower rate than the positions" in said
    tau[:, 1] = np.nan
    never = ZeroPhase(cutoff_hz=12)(replace(log, tau={"joint": tau}), robot()).report
    assert not [w for w in never.warnings if w.startswith("no row of")]


@pytest.mark.parametrize(("unit", "size"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_stamps_that_cannot_be_seconds_are_refused(unit: str, size: float) -> None:
    log = Truth().log(clock("even", 200.0, 20.0))
    with pytest.raises(
        DataError, match=rf"log run: the time stamps are .* s apart.*They look like {unit}, not s: name the column t_{unit}"
    ):
        ZeroPhase()(replace(log, t=log.t * size), robot())
    found = audit(LogSet((replace(log, t=log.t * size),)), robot()).of("time_unit")
    assert [f.severity.value for f in found] == ["error"]
    assert not audit(LogSet((log,)), robot()).of("time_unit")


def test_rounded_stamps_are_not_jitter() -> None:
    """3 kHz written with four decimals: the steps look uneven by a third, the samples are not."""
    truth = Truth()
    t = clock("even", 3000.0, 10.0)
    signals = ZeroPhase(cutoff_hz=30)(replace(truth.log(t), t=np.round(t, 4)), robot())
    assert signals.report.resampled.startswith("even")
    assert max(errors(signals, truth)) < 2e-4


def test_nearly_equal_stamps_do_no_harm() -> None:
    truth = Truth()
    t = np.sort(np.r_[clock("even", 300.0, 20.0), clock("even", 300.0, 20.0)[::50] + 1e-6])
    signals = ZeroPhase(cutoff_hz=10)(truth.log(t, noise=1e-5), robot())
    assert errors(signals, truth)[2] < 2e-3


class TestSettings:
    @pytest.mark.parametrize("name", preparation_names())
    def test_a_strategy_is_made_again_from_its_settings(self, name: str) -> None:
        prep = make_preparation(name, standstill={"fraction": 0.02})
        assert make_preparation(**prep.config()) == prep
        assert prep.config()["method"] == name

    @pytest.mark.parametrize(
        ("settings", "text"),
        [
            ({"method": "zerophase"}, "did you mean 'zero_phase'"),
            ({"cutof_hz": 3}, "did you mean 'cutoff_hz'"),
            ({"cutoff_hz": -3.0}, "cutoff_hz must be a positive number"),
            ({"decimate": 2.5}, "decimate"),
            ({"saturated": "drop"}, "unknown treatment"),
            ({"rows_near_reversals": "mask"}, "unknown use of rows near reversals"),
            ({"standstill": {"fractions": 0.1}}, "did you mean 'fraction'"),
            ({"standstill": {"fraction": 2.0}}, "fraction"),
            ({"velocity": "measured"}, "unknown source of velocity"),
            ({"order": 0}, "order"),
            ({"accuracy": 3}, "accuracy"),
        ],
    )
    def test_wrong_ones(self, settings: dict, text: str) -> None:
        with pytest.raises(ConfigurationError, match=text):
            make_preparation(**settings)

    def test_cutoff_above_half_the_rate(self) -> None:
        with pytest.raises(ConfigurationError, match="half the sample rate"):
            ZeroPhase(cutoff_hz=200)(Truth().log(clock("even", 300.0, 20.0)), robot())

    def test_too_short_a_run(self) -> None:
        with pytest.raises(DataError, match="too short for a cut-off of 1 Hz"):
            ZeroPhase(cutoff_hz=1)(Truth().log(clock("even", 300.0, 3.0)), robot())

    def test_which_robot(self) -> None:
        with pytest.raises(ConfigurationError, match="which robot"):
            ZeroPhase()(Truth().log(clock("even", 300.0, 3.0)))

    def test_wrong_robot(self) -> None:
        one = Robot.from_urdf(
            '<robot name="one"><link name="a"/><link name="b"/><joint name="x" type="revolute"><parent link="a"/><child link="b"/>'
            '<axis xyz="0 0 1"/></joint></robot>'
        )
        with pytest.raises(DataError, match="2 joints"):
            ZeroPhase()(Truth().log(clock("even", 300.0, 3.0)), one)


def test_report_reads_well() -> None:
    signals = ZeroPhase()(Truth().log(clock("jitter", 300.0, 30.0), noise=1e-5), robot())
    text = str(signals.report)
    for word in ("zero_phase", "turn", "slide", "resampled", "rows"):
        assert word in text
    data = signals.report.to_dict()
    assert data["joints"][1]["name"] == "slide"
    assert data["config"]["method"] == "zero_phase"


def test_thirty_joints_and_many_runs() -> None:
    links = "".join(f'<link name="l{k}"/>' for k in range(31))
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="0 0 1"/></joint>' for k in range(30)
    )
    many = Robot.from_urdf(f'<robot name="many">{links}{joints}</robot>')
    rng = np.random.default_rng(0)
    t = clock("even", 200.0, 20.0)
    make: Callable[[int], Log] = lambda k: Log(  # noqa: E731
        f"r{k}", t, np.sin(rng.uniform(1, 4, 30) * t[:, None] + k), tau={"joint": rng.standard_normal((len(t), 30))}
    )
    signals = ZeroPhase()(LogSet(tuple(make(k) for k in range(5)), many))
    assert len(signals.runs) == 5
    assert signals.tau.shape[1] == 30
