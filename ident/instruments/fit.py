"""The model fitted by instruments: the estimate whose residual is uncorrelated with columns of the instrument's motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .._utils.singular_values import lstsq, pinv
from ..effects.base import Effect
from ..effects.kinds import Need
from ..effects.motion import Motion
from ..effects.reference import Reference
from ..model import Model
from ..robots.transmission import Side
from .columns import effect_columns, on_motors, turns_fast
from .prior import prior_rows
from .solved import SINGULAR, Solved
from .spectra import Spectra
from .thresholds import FEW
from .whitening import density

if TYPE_CHECKING:
    from .known import Known
    from .rows import RunRows

Array = np.ndarray
_DEPENDENT = frozenset({Need.LOAD, Need.REFERENCE, Need.TORQUE})
#: By what the log of a residual's power may grow from pass to pass.
_WORSE = 0.02


def depends(effect: Effect) -> bool:
    """The effect's columns depend on what the model predicts."""
    return bool(effect.needs & _DEPENDENT)


@dataclass(eq=False)
class Fit:
    """Model and rows; `solve` makes a frame. `runs`: of one robot; `declared`: its model; `effects`: accepted beside it; `known`: what is
    known of the declared model from before, in the place of a weak prior."""

    runs: Sequence[RunRows]
    declared: Model
    effects: tuple[Effect, ...] = ()
    values: Array | None = field(default=None, repr=False)
    known: Known | None = field(default=None, repr=False)
    _kept: dict[Effect | None, tuple[list[Spectra], list[Spectra]]] = field(default_factory=dict, repr=False)
    _torque: list[Array] = field(default_factory=list, repr=False)
    _motions: dict[Any, Any] = field(default_factory=dict, repr=False)

    def with_effects(self, effects: tuple[Effect, ...]) -> Fit:
        """The same rows with other effects beside the declared model; values are taken over as far as parameters are the same."""
        other = Fit(self.runs, self.declared, effects, None, self.known, dict(self._kept), self._torque)
        if self.values is not None:
            known = dict(zip(self.model.names, self.values, strict=True))
            other.values = np.array([known.get(name, 0.0) for name in other.model.names])
        return other

    @cached_property
    def model(self) -> Model:
        """The declared model with the effects."""
        return Model(self.declared.robot, (*self.declared.effects, *self.effects))

    @property
    def robot(self):  # type: ignore[no-untyped-def]
        return self.declared.robot

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The coefficients of each accepted effect, behind those of the declared model's base parameters."""
        ends = np.cumsum([self.declared.base.count, *(len(e.parameters(self.robot)) for e in self.effects)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @cached_property
    def share(self) -> Array:
        """Share (n,) of the samples that each motor has in use, over all runs."""
        lengths = np.array([len(run.use) for run in self.runs], float)
        return np.asarray(np.average([run.share for run in self.runs], axis=0, weights=lengths))

    def motions(self, *, instrument: bool, effect: Effect | None = None) -> list[Motion]:
        """The runs' motions with what the model predicts along them.

        The instrument of an effect whose angle turns fast holds the measured positions: what a disturbance adds to an angle is lost in
        the mean over its turns, and a smoothed angle has lost the phase."""
        chosen = [run.instrument if instrument else run.measured for run in self.runs]
        fast = instrument and effect is not None and turns_fast(effect, self.robot, chosen)
        key = (instrument, fast)
        if self._motions.get("values") is not self.values:
            self._motions.clear()
            self._motions["values"] = self.values
        if key in self._motions:
            return self._motions[key]
        if fast:
            chosen = [
                replace(z, joint=replace(z.joint, q=x.joint.q), motor=replace(z.motor, q=x.motor.q))
                for z, x in zip(chosen, (run.measured for run in self.runs), strict=True)
            ]
        if self.values is not None:
            reference = Reference(self.model, self.values)
            for i, (motion, run) in enumerate(zip(chosen, self.runs, strict=True)):
                told = motion.with_reference(reference)
                chosen[i] = replace(told, torque=run.reading).with_load(reference.load(told))
        self._motions[key] = chosen
        return chosen

    def forget_motions(self) -> None:
        """Give back the memory of the motions and of what was derived along them; they are made again where they are asked for."""
        self._motions.clear()

    def sought(self, kind: type[Effect] | Effect) -> list[Motion]:
        """The motions along which ranges of an effect's shapes are taken: of what follows the reading, the measured ones."""
        return self.motions(instrument=Need.TORQUE not in kind.needs)

    def columns(self, effect: Effect | None, *, fresh: bool = False) -> tuple[list[Spectra], list[Spectra]]:
        """Columns of an effect (None: the declared model's base columns) for each run: of the measured motion, of the instrument."""
        if fresh or effect not in self._kept:
            self._kept[effect] = (self._made(effect, instrument=False), self._made(effect, instrument=True))
        return self._kept[effect]

    def _made(self, effect: Effect | None, *, instrument: bool) -> list[Spectra]:
        found = []
        for run, motion in zip(self.runs, self.motions(instrument=instrument, effect=effect), strict=True):
            if effect is None:
                values = self.declared.columns(motion)[:, :, self.declared.base.independent]
                side = self.robot.transmission.measured
            else:
                values, side = effect_columns(effect, motion, self.robot), Side.MOTOR
            found.append(Spectra.of(on_motors(values, side, self.robot), run))
        return found

    @property
    def torque(self) -> list[Array]:
        """Spectra (n, F) of the torque, for each run."""
        if not self._torque:
            for run in self.runs:
                self._torque.append(np.concatenate([run.masked_spectra(run.torque[:, m, None], m) for m in range(run.torque.shape[1])]))
        return self._torque

    # --- solving ------------------------------------------------------------------------------------------------------

    def solved(self, passes: int = 2) -> Solved:
        """The frame at the noise that its own residual shows, with columns taken at the values that it yields."""
        frame = self._solve(self.flat(None))
        best, free = np.inf, self._freed_of_knowledge()
        for _ in range(passes):
            before = (dict(self._kept), self.values)
            dependent = [e for e in self.effects if depends(e)]
            for effect in [*dependent, *([None] if self._dependent_declared else [])]:
                self.columns(effect, fresh=True)
            # Whitening must not feed on itself: the density is that of the residual of a fit with one weight for each motor.
            flat = self._solve(self.flat(frame))
            loose = flat if free is self else free._solve(flat.gains)
            size = self._size(flat)
            if size > best + _WORSE:
                # Columns that follow the values do not settle by repetition: the values before were better.
                self._kept, self.values = before
                break
            best = min(best, size)
            frame = self._solve(free._white(loose))
        return frame

    def _freed_of_knowledge(self) -> Fit:
        """The same without what is known before: what parameters that moved leave is no noise, so that it is told where all are free."""
        if self.known is None:
            return self
        return Fit(self.runs, self.declared, self.effects, self.values, None, self._kept, self._torque)

    def _size(self, frame: Solved) -> float:
        """Sum over the motors of the log of what a frame leaves."""
        power = self.noise(frame) ** 2
        return float(np.sum(np.log(power[power > 0])))

    def noise(self, frame: Solved) -> Array:
        """Root mean square (n,) of what a frame leaves of each motor's torque, where it is in use."""
        inner = [x[run.band.inner] for run, x in zip(self.runs, self.raw_residual(frame), strict=True)]
        return np.asarray(np.sqrt(np.mean(np.concatenate(inner) ** 2, axis=0) / np.maximum(self.share, 1e-9)))

    def behind(self, gains: tuple[Array, ...]) -> Solved:
        """The frame behind given whitening filters: at the noise that another model leaves."""
        return self._solve(gains)

    @property
    def _dependent_declared(self) -> bool:
        return any(depends(e) for e in self.declared.effects)

    def behind_filters(self, columns: Sequence[Spectra], gains: Sequence[Array]) -> Array:
        """Rows (R, n, k) of all runs' columns behind whitening filters; those that count."""
        return np.concatenate([each.behind(gain) for each, gain in zip(columns, gains, strict=True)])

    def _whitened(self, spectra: Sequence[Array], gains: Sequence[Array]) -> Array:
        """Rows (R, n) of all runs' spectra (n, F), one for each motor, behind whitening filters; those that count."""
        each = zip(self.runs, spectra, gains, strict=True)
        return np.concatenate([run.band.behind(own, gain).T for run, own, gain in each])

    def flat(self, frame: Solved | None) -> tuple[Array, ...]:
        """One weight for each motor: from the residual of a frame, or from the torque."""
        raw = self._rows(self.torque) if frame is None else self.raw_residual(frame)
        inner = np.concatenate([x[run.band.inner] for run, x in zip(self.runs, raw, strict=True)])
        size = np.sqrt(np.mean(inner**2, axis=0) / np.maximum(self.share, 1e-9))
        weight = np.where((self.share > FEW) & (size > 0), 1.0 / np.maximum(size, 1e-300), 0.0)
        return tuple(np.repeat(weight[:, None], len(run.band.frequencies), axis=1) for run in self.runs)

    def raw_residual(self, frame: Solved) -> list[Array]:
        """Rows (count, n) of the residual before whitening, for each run."""
        return self._rows(self._residual(frame))

    def _residual(self, frame: Solved) -> list[Array]:
        """Spectra (n, F) of the residual, for each run."""
        parts = [self.columns(e)[0] for e in (None, *self.effects)]
        theta = np.split(frame.theta, np.cumsum([x[0].width for x in parts])[:-1])
        return [y - sum(x[i].summed(own) for x, own in zip(parts, theta, strict=True)) for i, y in enumerate(self.torque)]

    def _rows(self, spectra: Sequence[Array]) -> list[Array]:
        """Rows (count, n) of spectra (n, F), for each run."""
        return [run.band.of_spectra(x).T for run, x in zip(self.runs, spectra, strict=True)]

    def at_usual_noise(self, frame: Solved) -> Array:
        """The residual (R, n) of a frame over the noise that most of the time has: what is loud now and then stands out."""
        return self._whitened(self._residual(frame), self._white(frame, "median"))

    def _white(self, frame: Solved, average: Literal["mean", "median"] = "mean") -> tuple[Array, ...]:
        raw = self.raw_residual(frame)
        n = self.robot.n
        freed = self._freed(frame)
        gains = [np.zeros((n, len(run.band.frequencies))) for run in self.runs]
        for m in range(n):
            if self.share[m] <= FEW:
                continue
            laws = [
                density(x[run.band.inner, m] / np.sqrt(max(run.share[m], 1e-9)), run.band.row_rate, run.band.top_hz, average)
                for run, x in zip(self.runs, raw, strict=True)
            ]
            for gain, run in zip(gains, self.runs, strict=True):
                f = run.band.frequencies
                level = np.mean([law(f) for law in laws], axis=0) * freed[m]
                good = bool(np.all(level > 0))
                gain[m] = (f <= 1.1 * run.band.top_hz) / np.sqrt(level * run.band.row_rate) if good else 0.0
        return tuple(gains)

    def in_band(self, frames: Sequence[Solved]) -> list[Array]:
        """One noise for several frames: the least that any of them leaves, at each frequency of the instrument's band; nothing beyond it,
        where the residual holds what feedback and the noise of the measured motion make."""
        return [
            np.max([x.gains[i] for x in frames], axis=0) * (run.band.frequencies <= run.cutoffs_hz[:, None])
            for i, run in enumerate(self.runs)
        ]

    def energy(self, frame: Solved, gains: Sequence[Array]) -> float:
        """Sum of squares of a frame's residual behind whitening filters."""
        return float(np.sum(self._whitened(self._residual(frame), gains) ** 2))

    def likelihood(self, frame: Solved) -> float:
        """Log-likelihood of a frame at the noise that it was solved at, if that is its own, as loud as what it leaves, up to a constant.

        What a spectrum is too smooth for (a slow drift, a line) is no noise: it counts by its size.

        P. Whittle, "Estimation and information in stationary time series", Arkiv för Matematik 2, 1953."""
        log_gains, count = np.zeros(self.robot.n), np.zeros(self.robot.n)
        for run, gain in zip(self.runs, frame.gains, strict=True):
            inside = gain[:, run.band.frequencies <= run.band.top_hz]
            seen = (inside > 0).all(axis=1)
            # Of as many values as the rows in use have: what lies between the band and half their rate is none.
            rows = (run.band.inner.stop - run.band.inner.start) * run.share * min(1.0, 2.0 * run.band.top_hz / run.band.row_rate)
            log_gains[seen] += rows[seen] * np.log(inside[seen]).mean(axis=1)
            count[seen] += rows[seen]
        seen = count > 0
        energy = np.sum(frame.residual**2, axis=0)[seen] / count[seen]
        return float(np.sum(log_gains[seen] - 0.5 * count[seen] * np.log(np.maximum(energy, 1e-300))))

    def _freed(self, frame: Solved) -> Array:
        """What each motor's residual (n,) lacks of the noise, because parameters took it up: a factor of its power."""
        R = frame.rows
        inverse = frame.solution.T / np.outer(frame.scale, frame.scale)
        taken = np.array([np.sum(inverse * (frame.X[:, m].T @ frame.Z[:, m])) for m in range(self.robot.n)])
        rows = R * self.share * min(1.0, 2.0 * self.runs[0].band.top_hz / self.runs[0].band.row_rate)
        return 1.0 / np.clip(1.0 - taken / np.maximum(rows, 1.0), 0.1, 1.0)

    def _solve(self, gains: tuple[Array, ...]) -> Solved:
        parts = [self.columns(e) for e in (None, *self.effects)]
        X, Z = (np.concatenate([self.behind_filters(part[side], gains) for part in parts], axis=2) for side in (0, 1))
        y = self._whitened(self.torque, gains)
        R, n, p = X.shape
        Xf, Zf = X.reshape(-1, p), Z.reshape(-1, p)
        known, told = self.known_rows(p), self._prior[1]
        gram = Zf.T @ Zf + known.T @ known
        scale = np.sqrt(np.diag(gram))
        scale = np.where(scale > 0, scale, 1.0)
        equations = (Zf.T @ Xf + known.T @ known) / np.outer(scale, scale)
        theta = lstsq(equations, (Zf.T @ y.reshape(-1) + known.T @ told) / scale, rcond=SINGULAR) / scale
        residual = y - (Xf @ theta).reshape(R, n)
        self.values = self._expanded(theta)
        edges = np.cumsum([0, *(run.band.inner.stop - run.band.inner.start for run in self.runs)]).tolist()
        return Solved(
            X, Z, residual, theta, scale, pinv(equations.T, rcond=SINGULAR), (known / scale).T @ (told - known @ theta),
            equations, gram / np.outer(scale, scale), gains, tuple(edges),
        )  # fmt: skip

    def known_rows(self, count: int) -> Array:
        """Rows (k, count) over the coefficients that do not come from the log."""
        rows, _ = self._prior
        return np.concatenate([rows, np.zeros((len(rows), count - rows.shape[1]))], axis=1)

    @cached_property
    def _prior(self) -> tuple[Array, Array]:
        """Rows (k, b) over the declared model's base parameters that do not come from the log, and their values (k,)."""
        if self.known is not None:
            return self.known.rows, self.known.told
        rows = prior_rows(self.declared)
        return rows, np.zeros(len(rows))

    def _expanded(self, theta: Array) -> Array:
        b = self.declared.base.count
        return np.concatenate([self.declared.base.expand(theta[:b]), theta[b:]])
