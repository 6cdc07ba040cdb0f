"""Filters and differences against analytic signals; the rows' filter exact, without phase shift, piece by piece as at once."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from ident._native.choice import compiled
from ident.errors import ConfigurationError
from ident.robots import robot_folder
from ident.signals import filters
from ident.signals.filters import RowFilter, butterworth_transient, central_differences, savitzky_golay_window, zero_phase_lowpass


@pytest.mark.parametrize("accuracy", [2, 4, 6, 8])
def test_central_differences_are_exact_for_polynomials(accuracy: int) -> None:
    rate = 50.0
    t = np.arange(60) / rate
    power = accuracy + (1 if accuracy > 2 else 0)  # even symmetry gives the second derivative one order more
    x = ((t - 0.5) ** power)[:, None]
    dx, ddx = central_differences(x, rate, accuracy)
    inner = t[accuracy // 2 : -(accuracy // 2)] - 0.5
    np.testing.assert_allclose(ddx[:, 0], power * (power - 1) * inner ** (power - 2), atol=1e-9)
    dx, _ = central_differences(((t - 0.5) ** accuracy)[:, None], rate, accuracy)
    np.testing.assert_allclose(dx[:, 0], accuracy * inner ** (accuracy - 1), atol=1e-10)


def test_higher_accuracy_pays_off() -> None:
    rate, f = 200.0, 12.0
    t = np.arange(400) / rate
    x = np.sin(2 * np.pi * f * t)[:, None]
    errors = []
    for accuracy in (2, 4, 6, 8):
        p = accuracy // 2
        _, ddx = central_differences(x, rate, accuracy)
        errors.append(np.abs(ddx[:, 0] + (2 * np.pi * f) ** 2 * x[p:-p, 0]).max() / (2 * np.pi * f) ** 2)
    assert errors == sorted(errors, reverse=True)
    assert errors[0] == pytest.approx((2 * np.pi * f / rate) ** 2 / 12, rel=0.05)
    assert errors[2] < 1e-4


def test_differences_of_too_few_samples() -> None:
    assert len(central_differences(np.zeros((3, 1)), 1.0, 6)[0]) == 0
    with pytest.raises(ConfigurationError, match="2, 4, 6 or 8"):
        central_differences(np.zeros((30, 1)), 1.0, 3)


def test_lowpass_has_no_phase_and_half_gain_at_its_cutoff() -> None:
    rate, cutoff = 500.0, 20.0
    t = np.arange(4000) / rate
    for f, gain in ((2.0, 1.0), (20.0, 0.5), (60.0, 0.0)):
        x = np.sin(2 * np.pi * f * t)[:, None]
        y = zero_phase_lowpass(x, cutoff, rate)[1000:-1000, 0]
        inner = t[1000:-1000]
        in_phase = 2 * np.mean(y * np.sin(2 * np.pi * f * inner))
        quadrature = 2 * np.mean(y * np.cos(2 * np.pi * f * inner))
        assert in_phase == pytest.approx(gain, abs=2e-3)
        assert abs(quadrature) < 1e-3


def test_lowpass_refuses_a_cutoff_above_half_the_rate() -> None:
    with pytest.raises(ConfigurationError, match="half the sample rate"):
        zero_phase_lowpass(np.zeros((100, 1)), 60.0, 100.0)


@pytest.mark.parametrize("order", [2, 4, 6])
def test_transient_is_over_after_its_length(order: int) -> None:
    """A kink outside leaves a hundredth of its effect on the acceleration."""
    rate, cutoff = 1000.0, 10.0
    t = np.arange(6000) / rate
    kinked = np.where(t < 3.0, 0.0, t - 3.0)[:, None]
    y = zero_phase_lowpass(kinked, cutoff, rate, order)
    _, ddy = central_differences(y, rate)
    after = 3.0 + butterworth_transient(cutoff, order)
    inside = np.abs(ddy[:, 0]) < 0.03 * np.abs(ddy).max()
    assert inside[t[3:-3] > after].all()


def test_savitzky_golay_window_has_the_cutoff() -> None:
    from scipy.signal import savgol_coeffs

    for degree in (2, 4):
        rate, cutoff = 1000.0, 25.0
        window = savitzky_golay_window(cutoff, rate, degree)
        taps = savgol_coeffs(window, degree)
        offset = np.arange(window) - window // 2
        assert taps @ np.cos(2 * np.pi * cutoff / rate * offset) == pytest.approx(np.sqrt(0.5), abs=0.03)


class TestRowFilter:
    def test_is_what_it_says(self) -> None:
        rate, cutoff = 1000.0, 40.0
        filter_ = RowFilter.lowpass(cutoff, rate, 10)
        gain = filter_.gain(np.array([0.0, 0.4 * cutoff, cutoff, 1.6 * cutoff, 5 * cutoff]), rate)
        np.testing.assert_allclose(gain, [1.0, 1.0, 0.5, 0.0, 0.0], atol=0.025)

    def test_rows_are_centred(self) -> None:
        """A straight line passes unchanged, and so tells at which instant each row stands."""
        filter_ = RowFilter.lowpass(3.0, 100.0, 7)
        x = np.arange(500.0)
        np.testing.assert_allclose(filter_.apply(x), filter_.centres(500), rtol=1e-12)

    def test_against_convolution(self) -> None:
        rng = np.random.default_rng(0)
        filter_ = RowFilter.lowpass(10.0, 200.0, 4)
        x = rng.standard_normal((300, 3, 2))
        expected = np.apply_along_axis(lambda c: np.convolve(c, filter_.taps, "valid")[::4], 0, x)
        np.testing.assert_allclose(filter_.apply(x), expected, atol=1e-13)
        assert filter_.count(300) == len(expected)

    @pytest.mark.parametrize("samples", [0, 1, 20])
    def test_short_runs_have_no_rows(self, samples: int) -> None:
        filter_ = RowFilter.lowpass(3.0, 100.0, 7)
        assert filter_.apply(np.zeros((samples, 2))).shape == (0, 2)

    def test_refuses_what_would_shift_time(self) -> None:
        with pytest.raises(ConfigurationError, match="symmetric"):
            RowFilter(np.array([0.2, 0.3, 0.5]))
        with pytest.raises(ConfigurationError, match="odd number"):
            RowFilter(np.array([0.5, 0.5]))
        with pytest.raises(ConfigurationError, match="at least 1"):
            RowFilter(np.array([1.0]), 0)


@pytest.mark.parametrize("order", range(1, 9))
@pytest.mark.parametrize("cutoff", [0.05, 2.0, 30.0, 90.0])
def test_the_low_pass_is_the_butterworth_filter_of_scipy(order: int, cutoff: float) -> None:
    sections = filters.butterworth_sections(cutoff, 200.0, order)
    frequency = np.geomspace(1e-3, 99.0, 200)
    found = signal.sosfreqz(sections, frequency, fs=200.0)[1]
    expected = signal.sosfreqz(signal.butter(order, cutoff, fs=200.0, output="sos"), frequency, fs=200.0)[1]
    # Far below half the rate a coefficient's last digit is a share ε (rate / cut-off)² of what the poles leave of one.
    assert np.abs(found - expected).max() <= 1e-12 + 4e-16 * (200.0 / (2 * np.pi * cutoff)) ** 2 * order
    settled = filters._butterworth(cutoff, 200.0, order)[1]
    out, after = signal.sosfilt(sections, np.ones(5), zi=settled)
    assert np.allclose(out, 1.0, rtol=1e-6)
    assert np.allclose(after, settled, rtol=1e-6)


@pytest.mark.parametrize("cutoff", [0.5, 3.0, 40.0, 80.0])
def test_the_filter_of_the_rows_is_the_kaiser_design_of_scipy(cutoff: float) -> None:
    count, beta = signal.kaiserord(40.0, min(0.95, 2 * cutoff / 200.0))
    expected = signal.firwin(count | 1, cutoff, window=("kaiser", beta), fs=200.0)
    taps = RowFilter.lowpass(cutoff, 200.0, 1).taps
    assert taps == pytest.approx(expected, rel=1e-12, abs=1e-15)


@pytest.mark.skipif(compiled("_filters") is None, reason="without the compiled filters scipy.signal filters")
def test_a_check_needs_no_part_of_scipy_that_takes_long_to_import() -> None:
    code = (
        "import sys; from ident.cli import main; main(['check', '--robot', 'puma560', '--log', sys.argv[1]]);"
        " slow = {'scipy.signal', 'scipy.stats', 'scipy.interpolate', 'pandas', 'ident.diagnosis'};"
        " print(sorted(slow & set(sys.modules)), file=sys.stderr)"
    )
    log = robot_folder("puma560") / "demo" / "train.csv.gz"
    run = subprocess.run([sys.executable, "-c", code, str(log)], capture_output=True, text=True, check=True)
    assert run.stderr.splitlines()[-1] == "[]"


@pytest.mark.parametrize("cutoff", [1e-5, 1e-28, 1e-320])
def test_a_row_filter_longer_than_any_run_is_refused(cutoff: float) -> None:
    with pytest.raises(ConfigurationError, match=r"asks for a filter of .* samples: decimate less"):
        RowFilter.lowpass(cutoff, 1000.0, 10)
