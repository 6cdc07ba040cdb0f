"""Validation: how well an estimate predicts data that it did not see."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.threads import with_one_blas_thread
from ..drawing.document import Figure, Section, Text
from ..drawing.shown import Shown
from ..errors import ConfigurationError, DataError
from ..estimate.pictures import error_frame, error_section, torque_figure
from ..estimate.summary import error_table
from ..problem.linear_solution import solve_triangle
from ..problem.problem import error_on
from ..signals.known_band import within_known_band
from ..simulation.replay import replay
from ..statistics.torque_error import TorqueError

if TYPE_CHECKING:
    import pandas as pd

    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from ..simulation.replay import Replay

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Shown, ShortRepr):
    """Errors on held-out data.

    `error`: torque error over all runs; `by_run`: the same run by run; `nominal`: the error with the URDF's own inertials and
    only the drive parameters fitted (None where the URDF has none); `replay`: forward simulation against the measured
    trajectory, if it was asked for and can be made; `noise_share` (n,): rms error over the rms that the fit left, per joint (1 = as
    good); `notes`: what was left out, and why; `signals`: the held-out data.

    See `ident.validate`.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> validation = ident.validate(ident.fit(train, robot, held=0), test)
    >>> list(validation.by_run)
    ['validate']
    """

    estimate: Estimate
    error: TorqueError
    by_run: dict[str, TorqueError]
    nominal: TorqueError | None
    replay: Replay | None
    noise_share: Array
    notes: tuple[str, ...] = ()
    signals: Signals | None = field(default=None, repr=False)

    @property
    def errors(self) -> dict[str, TorqueError]:
        """Torque errors by what they are of: the fit, the held-out data, and those with the URDF's inertials."""
        nominal = {} if self.nominal is None else {"URDF inertials": self.nominal}
        return {"fit": self.estimate.fit_error, "held out": self.error} | nominal

    def figure(self) -> Figure:
        """Measured against predicted torque with the residual on the held-out data; see `plot`."""
        if self.signals is None:
            raise ConfigurationError("this validation does not hold its signals; make it with ident.validate(estimate, signals).")
        return torque_figure(self.estimate, self.signals, "held-out")

    def to_frame(self) -> pd.DataFrame:
        """One row per joint and one for all: rms (N m, N) and relative torque error (a share) of fit and held-out data."""
        return error_frame(self.estimate.model.robot, self.errors)

    def sections(self) -> tuple[Section, ...]:
        """Torque errors and notes."""
        table = error_section(self.estimate.model.robot, self.errors)
        return (table, *([Text("Notes", self.notes)] if self.notes else []))

    def to_dict(self) -> dict[str, Any]:
        """JSON form (without the common fields)."""
        return {
            "method": self.estimate.method,
            "torque_error": {"fit": self.estimate.fit_error.to_dict(), "heldout": self.error.to_dict()},
            "by_run": {name: error.to_dict() for name, error in self.by_run.items()},
            "nominal": None if self.nominal is None else self.nominal.to_dict(),
            "heldout_over_fit": self.noise_share,
            "replay": None if self.replay is None else self.replay.to_dict(),
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        errors = {"fit": self.estimate.fit_error, "held out": self.error}
        if len(self.by_run) > 1:
            errors |= {f"  {name}": error for name, error in self.by_run.items()}
        if self.nominal is not None:
            errors["URDF inertials"] = self.nominal
        lines = [error_table(self.estimate, errors)]
        if self.replay is not None:
            lines += ["", str(self.replay)]
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines)


@with_one_blas_thread
def validate(estimate: Estimate, signals: Any, *, simulate: bool = False) -> Validation:
    """Predict the torque of data held out, and with `simulate` replay them by forward simulation.

    Parameters
    ----------
    estimate : Estimate
        What predicts.
    signals : Signals or logs
        Data that the fit did not see; logs (also a path) are prepared as the fit's were.
        Raw differences of positions are judged within the band where the motion is known.
    simulate : bool
        Simulate windows from the measured state under the measured torque. Where that cannot be done (a joint without torque), a note
        says so.

    Returns
    -------
    Validation
        Torque error for each joint and run, beside that of the URDF's own inertials; error of the replayed motion.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> validation = ident.validate(ident.fit(train, robot, held=0), ident.ZeroPhase()(test, robot))
    >>> bool(validation.error.relative_all < 0.01)
    True
    """
    raw = estimate.prepared(signals)
    signals = within_known_band(raw)
    residual = estimate.residual(signals)
    error = error_on(signals, residual, raw=raw is not signals)
    by_run = {
        name: TorqueError.of(residual[rows], signals.tau[rows], error.judged, error.band_hz)
        for name, rows in _named_runs(signals.run_names, signals.row_runs).items()
    }
    replayed: Replay | None = None
    notes: tuple[str, ...] = ()
    if simulate:
        try:
            replayed = replay(estimate.model, estimate.all_values, signals)
        except DataError as refused:
            notes = (f"the motion was not replayed: {refused}",)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = error.rms / estimate.fit_error.rms
    return Validation(estimate, error, by_run, _like(nominal_error(estimate, signals), error), replayed, share, notes, signals)


def _like(error: TorqueError | None, other: TorqueError) -> TorqueError | None:
    """An error on the same signals as another one."""
    return None if error is None else replace(error, judged=other.judged)


def _named_runs(names: tuple[str, ...], rows: tuple[slice, ...]) -> dict[str, slice]:
    out: dict[str, slice] = {}
    for name, part in zip(names, rows, strict=True):
        label, count = name, 2
        while label in out:
            label, count = f"{name}#{count}", count + 1
        out[label] = part
    return out


def nominal_values(estimate: Estimate) -> Array | None:
    """Base values (b,) with the rigid body as the URDF has it and everything else fitted to the same data; None without inertials.

    A base parameter into which a drive parameter is grouped (Izz + reflected rotor inertia) stays free."""
    robot, information = estimate.model.robot, estimate.information
    if robot.nominal is None or information is None:
        return None
    base = estimate.model.base
    if base.names != information.names:
        return None
    rigid = np.array([p.effect == "rigid_body" for p in base.parameters])
    start = np.zeros(len(rigid))
    start[rigid] = robot.nominal
    values = base.base_values(start)
    free = np.flatnonzero(np.any(base.regroup[:, ~rigid] != 0, axis=1))
    R, z, _ = information.combined(estimate.weights)
    if len(free):
        part = np.zeros((len(values) + 1, len(free) + 1))
        part[:-1, :-1] = R[:, free]
        part[:-1, -1] = z - R @ values
        Q = np.asarray(np.linalg.qr(part, mode="r"))
        solution = solve_triangle(Q[: len(free), : len(free)], Q[: len(free), -1])
        change = np.zeros(len(free))
        change[solution.columns] = solution.values
        values = values.copy()
        values[free] += change
    return values


def nominal_error(estimate: Estimate, signals: Signals) -> TorqueError | None:
    """Torque error on `signals` with `nominal_values`."""
    values = nominal_values(estimate)
    return None if values is None else estimate.problem_on(signals).torque_error(values)
