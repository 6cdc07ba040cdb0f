"""How a log came about, so that it can be repeated on a model: torque-driven, or a controller that tracks a desired motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError, DataError, unknown_name
from ..robots.transmission import Side
from ..signals.filters import zero_phase_lowpass
from ..signals.uniform import Recording
from ..simulation.command import Feedback
from ..simulation.controller import PDFeedforward
from ..simulation.plant import Plant
from ..simulation.sensors import Sensors, TorqueWindow
from ..simulation.simulate import Hold, simulate_batch

if TYPE_CHECKING:
    from ..logs.log import Log
    from ..model import Model
    from ..signals.signals import Signals
    from ..simulation.controller import Controller
    from ..simulation.result import Simulation
    from ..simulation.trajectory import Trajectory

Array = np.ndarray
#: A torque-driven motion is repeated in pieces of this length, s.
_OPEN_WINDOW_S = 1.0
#: Counts a motor turn of encoders that round next to nothing, and leave a double's digits to the position.
_FINE = 1e12


@dataclass(frozen=True, eq=False)
class Desired:
    """A desired joint-side motion as recorded: `t` (K,) s in the log's time, `motion` (K, n)."""

    t: Array
    motion: Coordinates

    @classmethod
    def from_log(cls, log: Log, columns: Sequence[str], cutoff_hz: float | None = None) -> Desired:
        """From extra columns of a log that hold the desired joint positions in rad (m), one a joint.

        Derivatives are those of a spline through them. `cutoff_hz`: low-pass first, where the log holds a coarse reference."""
        from scipy.interpolate import make_interp_spline

        for column in columns:
            if column not in log.extra:
                raise unknown_name(f"column of log {log.name}", column, log.extra)
        q = np.stack([np.asarray(log.extra[c], float) for c in columns], axis=1)
        if cutoff_hz is not None:
            q = zero_phase_lowpass(q, cutoff_hz, 1.0 / float(np.median(np.diff(log.t))))
        spline = make_interp_spline(log.t, q, k=5)
        return cls(log.t, Coordinates(q, spline(log.t, 1), spline(log.t, 2)))

    def sample(self, t: Array) -> Coordinates:
        """Motion (N, n) at times in the log's time; it stands still outside."""
        from scipy.interpolate import CubicHermiteSpline, make_interp_spline

        inside = np.clip(t, self.t[0], self.t[-1])
        moving = (inside == t)[:, None]
        rate = CubicHermiteSpline(self.t, self.motion.dq, self.motion.ddq)
        q = CubicHermiteSpline(self.t, self.motion.q, self.motion.dq)(inside)
        ddq = make_interp_spline(self.t, self.motion.ddq, k=1)(inside)
        return Coordinates(q, rate(inside) * moving, ddq * moving)


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """How the runs of a log were driven.

    `controller`: what tracked the desired motion; None where the recorded torque was commanded in open loop.
    `desired`: run name → trajectory or recorded motion, in the log's time; "*" stands for every run.
    `control_rate`: Hz (default: the log's rate). The log is repeated in windows of `window_s`, side by side (default: 1 s in open
    loop, where errors grow; whole runs under a controller). A closed loop starts `settle_s` before each window from the desired
    state, to forget it: at least a few of its time constants. `step`: longest integration step, s (default: one control period)."""

    controller: Controller | None = None
    desired: Mapping[str, Trajectory | Desired] = field(default_factory=dict)
    control_rate: float | None = None
    window_s: float | None = None
    settle_s: float = 0.5
    step: float | None = None
    sensing: Feedback | None = None
    torque_window: float = 0.0
    assumed: str = ""

    def __post_init__(self) -> None:
        if not (self.torque_window >= 0 and np.isfinite(self.torque_window)):
            raise ConfigurationError(f"an experiment's torque_window is a time in seconds from 0 on, not {self.torque_window!r}.")
        if self.controller is not None and not self.desired:
            raise ConfigurationError(
                'an experiment with a controller needs the desired motion that it tracked: desired = {run: motion}, or {"*": motion}.'
            )
        if (self.window_s is not None and not self.window_s > 0) or self.settle_s < 0:
            raise ConfigurationError("an experiment's window_s must be positive, and settle_s not negative (seconds).")

    @property
    def feedback(self) -> bool:
        """Whether measured torque is an answer to measured motion."""
        return self.controller is not None

    def desired_motion(self, signals: Signals) -> Coordinates:
        """Desired motion (N, n) at the signals' samples. Raises ConfigurationError for a run without one."""
        parts = [self._desired(name, signals.t[run]) for name, run in zip(signals.run_names, signals.runs, strict=True)]
        return Coordinates(*(np.concatenate([getattr(p, k) for p in parts]) for k in ("q", "dq", "ddq")))

    def _desired(self, run: str, t: Array) -> Coordinates:
        found = self.desired.get(run, self.desired.get("*"))
        if found is None:
            raise unknown_name("run with a desired motion", run, self.desired)
        return found.sample(t)

    def repeat(self, model: Model, values: Array, signals: Signals) -> tuple[Coordinates, Array]:
        """Motion and torque on the measured side, (N, n) each, that the model with all values (k,) makes in this experiment.

        NaN where it cannot be repeated. Raises DataError where no run is as long as a window, or the motion diverges."""
        out = Coordinates(*(np.full(signals.q.shape, np.nan) for _ in range(3)))
        torque = np.full(signals.q.shape, np.nan)
        windows = self._windows(signals)
        if not windows:
            raise DataError("no run of the log holds two samples; the experiment cannot be repeated.")
        made = self._closed(model, values, signals, windows) if self.feedback else self._open(model, values, signals, windows)
        for (start, stop), (motion, drive) in zip(windows, made, strict=True):
            for target, source in ((out.q, motion.q), (out.dq, motion.dq), (out.ddq, motion.ddq), (torque, drive)):
                target[start:stop] = source[: stop - start]
        return out, torque

    def _windows(self, signals: Signals) -> list[tuple[int, int]]:
        """First and last sample of windows that tile every run; a short rest joins the window before."""
        window = self.window_s or (np.inf if self.feedback else _OPEN_WINDOW_S)
        found = []
        for run in signals.runs:
            count = max(1, int((run.stop - run.start) / max(2.0, window * signals.rate)))
            edges = np.linspace(run.start, run.stop, count + 1).astype(int).tolist()
            found += [(a, b) for a, b in pairwise(edges) if b - a >= 2]
        return found

    def _closed(self, model: Model, values: Array, signals: Signals, windows: list[tuple[int, int]]) -> list[tuple[Coordinates, Array]]:
        every = max(1, round((self.control_rate or signals.rate) / signals.rate))
        control = every * signals.rate
        names = {i: name for name, run in zip(signals.run_names, signals.runs, strict=True) for i in range(run.start, run.stop)}
        settle = round(self.settle_s * signals.rate)
        samples = settle + max(b - a for a, b in windows)
        lanes = []
        for a, _ in windows:
            t = signals.t[a] + (np.arange((samples - 1) * every + 1) - settle * every) / control
            lanes.append(self._desired(names[a], t))
        step = self.step or 1.0 / control
        runs = simulate_batch(
            Plant(model, values), desired=lanes, controller=self.controller, rate=signals.rate, control_rate=control, step=step,
            start=(np.array([d.q[0] for d in lanes]), np.array([d.dq[0] for d in lanes])), feedback=self._unrounded(),
            sensors=self._recording(),
        )  # fmt: skip
        made = [self._recorded(run) for run in runs]
        return [(Coordinates(m.q[settle:], m.dq[settle:], m.ddq[settle:]), torque[settle:]) for m, torque in made]

    def _unrounded(self) -> Feedback:
        if self.sensing is None or self.sensing.counts is None:
            return self.sensing or Feedback()
        return replace(self.sensing, counts=max(_FINE, self.sensing.counts))

    def _recording(self) -> Sensors:
        return Sensors((TorqueWindow(self.torque_window),) if self.torque_window else (), Side.JOINT)

    def _recorded(self, run: Simulation) -> tuple[Coordinates, Array]:
        """Motion and torque of a run as the log would have them: accelerations are means over the torque's window too."""
        if not self.torque_window:
            return run.link, run.tau
        ends = [run.readings.exact_motion(np.clip(run.t + side * self.torque_window / 2, run.t[0], run.t[-1])) for side in (-1, 1)]
        span = np.minimum(run.t + self.torque_window / 2, run.t[-1]) - np.maximum(run.t - self.torque_window / 2, run.t[0])
        return Coordinates(run.q, run.dq, (ends[1].dq - ends[0].dq) / span[:, None]), run.readings.tau

    def _open(self, model: Model, values: Array, signals: Signals, windows: list[tuple[int, int]]) -> list[tuple[Coordinates, Array]]:
        samples = max(b - a for a, b in windows)
        last = len(signals.t) - 1
        at = np.minimum(np.array([a for a, _ in windows])[None, :] + np.arange(samples)[:, None], last)
        torque = signals.torque[at]
        sound = np.isfinite(torque).all(axis=(0, 2))
        if not sound.any():
            raise DataError("the torque of some joint is missing in every window: the log cannot be repeated in open loop.")
        starts = at[0, sound]
        runs = iter(
            simulate_batch(
                Plant(model, values),
                torque=torque[:, sound],
                start=(signals.q[starts], signals.dq[starts]),
                rate=signals.rate,
                hold=Hold.FIRST_ORDER,
                step=self.step or 1.0 / signals.rate,
            )
        )
        missing = np.full((samples, model.robot.n), np.nan)
        unknown = Coordinates(missing, missing, missing)
        return [(next(runs).link, torque[:, i]) if good else (unknown, missing) for i, good in enumerate(sound)]


def desired_from_logs(logs: Iterable[Log], columns: Sequence[str], cutoff_hz: float | None = None) -> dict[str, Desired]:
    """Desired motion of every log, from its columns.

    Parameters
    ----------
    logs : iterable of Log
        Runs that recorded the desired motion.
    columns : sequence of str
        Names in `log.extra`, one per joint.
    cutoff_hz : float, optional
        See `Desired.from_log`.

    Returns
    -------
    dict of str to Desired
        By the name of the log.

    Examples
    --------
    >>> import ident, numpy as np
    >>> t = np.arange(200) / 100
    >>> log = ident.Log("run", t=t, q=np.sin(t)[:, None], extra={"q_ref1": np.sin(t)})
    >>> list(ident.estimators.desired_from_logs([log], ["q_ref1"]))
    ['run']
    """
    return {log.name: Desired.from_log(log, columns, cutoff_hz) for log in logs}


def require_experiment(value: object, method: str) -> None:
    """Raises ConfigurationError for what a study file may hold in its place."""
    if value is not None and not isinstance(value, Experiment):
        raise ConfigurationError(
            f"method {method!r}: experiment is a Python object (ident.estimators.Experiment), which a study file cannot give. There, use"
            " 'iv' without it for torque-driven logs, else 'wls'."
        )


def assumed_experiment(
    logs: Iterable[Log], model: Model, values: Array, cutoff_hz: float, *, frequency_hz: float = 10.0, window_s: float = 1.5
) -> Experiment:
    """An experiment for logs without reference or controller: the measured motion serves as reference, a PD law as controller.

    The cut-off must pass the motion and stop the encoders' noise, or the estimate is biased as least squares is. What the motion
    has above it, starts and reversals, is missing in the simulated torque.

    Parameters
    ----------
    logs : iterable of Log
        Runs with positions.
    model : Model
        With rotor inertia, on which the controller is tuned.
    values : array (k,)
        All parameters of the model.
    cutoff_hz : float
        The measured motion below it is the reference.
    frequency_hz : float
        Bandwidth of the PD law with feedforward.
    window_s : float
        Length of the windows in which the experiment is repeated.

    Returns
    -------
    Experiment

    Examples
    --------
    >>> import ident
    >>> from ident.robots import nominal_values
    >>> train, _ = ident.demo_logs()
    >>> model = ident.load_robot("puma560").rigid_body() + ident.friction.RotorInertia()
    >>> ident.estimators.assumed_experiment(train, model, nominal_values(model), cutoff_hz=10.0).window_s
    1.5
    """
    from scipy.interpolate import make_interp_spline

    desired: dict[str, Trajectory | Desired] = {}
    for log in logs:
        recording = Recording.of(log, model.robot)
        rate = (len(recording.t) - 1) / float(recording.t[-1] - recording.t[0])
        t = recording.t[0] + np.arange(len(recording.t)) / rate
        q = np.stack([np.interp(t, recording.t, x) for x in recording.q.T], axis=1)
        every = max(1, int(rate / (20.0 * cutoff_hz)))
        t, q = t[::every], zero_phase_lowpass(q, cutoff_hz, rate)[::every]
        spline = make_interp_spline(t, q, k=5)
        desired[log.name] = Desired(t, Coordinates(q, spline(t, 1), spline(t, 2)))
    return Experiment(
        controller=PDFeedforward.tuned(model, values, frequency_hz=frequency_hz), desired=desired, window_s=window_s,
        settle_s=3.0 / frequency_hz,
        assumed=f"the reference and its controller are not known; the measured motion below {cutoff_hz:g} Hz and a PD law with feedforward"
        f" of {frequency_hz:g} Hz are used in their place.",
    )  # fmt: skip
