"""Monitoring: what has changed since a fit, told from new logs alone, with the doubt of the fit counted in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..diagnosis.analysis import without_reversals
from ..diagnosis.candidates import Candidate, candidates
from ..diagnosis.findings import Imitator
from ..diagnosis.frame import Motions, raw_columns
from ..diagnosis.search import Bank, Hit, Judged, Search
from ..diagnosis.selection import FALSE_ALARM, Stage, ranked, threshold, touched
from ..diagnosis.weights import weights
from ..errors import ConfigurationError, DataError
from ..problem import Problem
from ..torque_error import TorqueError
from .candidates import Place, own_changes
from .frame import KnownFrame, noise_of
from .result import Change, ChangedParameter, Drift, How, Monitoring

if TYPE_CHECKING:
    from ..diagnosis.whitening import Whitener
    from ..effect import Effect
    from ..estimate import Estimate
    from ..signals import Signals

Array = np.ndarray
_MOST = 8
#: A change that explains less than this share of what is left on its joints is of no account, however sure it is: no model is exact.
_LEAST_SHARE = 0.01
#: Rivals less probable than this are not named; nothing is surer than the upper bound, for the catalogue may lack the true one.
_NAMED, _SUREST = 0.01, 0.99
#: Free parameters must foretell blocks that they were not fitted to better, by this many standard errors.
_SURE = 3.0
#: A total may lie beyond its bound by this many standard deviations.
_BEYOND = 3.0


def monitor(
    estimate: Estimate, signals: Signals, *, reference: Signals | None = None, progress: Callable[[float], None] | None = None
) -> Monitoring:
    """Compare new logs with a saved fit.

    `signals`: the new logs, prepared like those of the fit (`ident.session.like(estimate.signals_config)`). `reference`: the
    logs of the fit itself, prepared likewise; with them an effect that the model never had is told from one that is new.
    `progress`: called with the share done. Raises ConfigurationError where the robots differ, DataError where rows are too few."""
    if signals.robot.joint_names != estimate.model.robot.joint_names:
        raise ConfigurationError(
            f"the logs are of a robot with the joints {', '.join(signals.robot.joint_names)}; the fit has"
            f" {', '.join(estimate.model.robot.joint_names)}."
        )
    watch = _Watch(estimate, signals, reference, progress)
    watch.search()
    return watch.result()


class _ChangeSearch(Search):
    """A search in which the model's own effects keep their shapes, and bounds hold for totals."""

    frame: KnownFrame

    def __init__(self, stage: Stage, own: dict[Candidate, Place], estimate: Estimate) -> None:
        super().__init__(stage.frame, stage.motions, stage.search.candidates, stage.search.bank)
        self.own, self.estimate = own, estimate

    def refined(self, hit: Hit) -> Hit:
        return hit if hit.candidate in self.own else super().refined(hit)

    def judge(self, hit: Hit) -> Judged:
        if hit.candidate in self.own:
            score = self.frame.score(hit.columns)
            return Judged(hit, score, self._beyond(hit, score.values))
        if absorbed(self.frame, hit.columns):
            # Part of what the model holds anyway: more or less of it are both possible.
            return Judged(hit, self.frame.score(hit.columns), "")
        return super().judge(hit)

    def _beyond(self, hit: Hit, change: Array) -> str:
        for p, by in zip(self.own[hit.candidate].parameters, change, strict=True):
            if p.name in self.estimate.names:
                at = self.estimate.index(p.name)
                total = float(self.estimate.values[at] + by)
                if not p.lower - _BEYOND * self.estimate.std[at] <= total <= p.upper + _BEYOND * self.estimate.std[at]:
                    return f"{p.name} would be {total:.4g} {p.unit}, beyond its bound"
        return ""


def _surplus(judged: Judged, stage: Stage) -> float:
    """Evidence above what chance reaches over all that is tried.

    An F test: the noise is as large as what is left beside the change, known no better than the rows tell."""
    from scipy.stats import chi2, f

    frame, rows = stage.frame, touched(judged.hit.columns)
    assert isinstance(frame, KnownFrame)
    shapes, k = 2.0 * len(judged.hit.effect.shape()), judged.hit.columns.shape[2]
    tail = float(chi2.sf(threshold(judged.hit, stage.number) - shapes, k))
    left = float(np.sum(frame.residual[rows] ** 2)) - judged.score.fit_gain
    level = max(1.0, left / max(1, int(stage.problem.signals.valid[:, rows].sum())))
    return judged.evidence / level - k * float(f.isf(tail, k, frame.freedom(rows))) - shapes


def absorbed(frame: KnownFrame, Z: Array) -> bool:
    """Whether whitened columns lie in the span of the model's own, if these were free."""
    p = frame.products(Z)
    b = frame.own
    G, C, D = frame.gram[:-1, :b, :b].sum(axis=0), p.cross[:, :, :b].sum(axis=0), p.own.sum(axis=0)
    left = D - C @ np.linalg.pinv(G, rcond=1e-12, hermitian=True) @ C.T
    return bool(np.trace(left) < 1e-6 * np.trace(D))


class _Watch:
    """The state of one monitoring: accepted changes, nuisances, and the frame beside them."""

    def __init__(self, estimate: Estimate, signals: Signals, reference: Signals | None, progress: Callable[[float], None] | None) -> None:
        self.estimate, self.whole, self.progress = estimate, signals, progress
        self.signals = without_reversals(signals.without_turning(estimate.sticking))
        self.problem = Problem(estimate.model, self.signals, reference=estimate.all_values)
        self.raw = raw_columns(self.problem)
        if int(self.signals.valid.sum()) < 4 * self.raw.shape[2]:
            raise DataError(
                f"only {int(self.signals.valid.sum())} usable rows for {self.raw.shape[2]} parameters: too few to tell a change from"
                " chance; give a longer log."
            )
        self.plain = KnownFrame.of(self.problem, noise_of(estimate, self.signals), estimate, self.raw)
        self.motions = Motions(self.problem)
        self.own = own_changes(estimate.model)
        self.candidates = (*self.own, *candidates(estimate.model, self.motions.parts[0][1]))
        self.bank = Bank()
        self.found: list[tuple[Judged, tuple[Judged, ...], Array]] = []
        self.nuisance: list[Effect] = []
        self.old = None if reference is None else _Reference(estimate, reference)
        self._step(0.1)

    def _step(self, share: float) -> None:
        if self.progress is not None:
            self.progress(share)

    def frame(self, effects: Sequence[Effect]) -> KnownFrame:
        """The frame beside effects."""
        frame = self.plain
        for effect in effects:
            frame = frame.beside(frame.whitened(self.motions.columns(effect)))
        return frame

    @property
    def beside(self) -> list[Effect]:
        """Nuisances, then the changes found."""
        return [*self.nuisance, *(judged.hit.effect for judged, _, _ in self.found)]

    def stage(self, effects: Sequence[Effect]) -> Stage:
        """Everything that scores candidates beside effects."""
        frame = self.frame(effects)
        plain = Search(frame, self.motions, self.candidates, self.bank)
        stage = Stage(self.problem, frame.white, frame, self.motions, plain)
        return Stage(self.problem, frame.white, frame, self.motions, _ChangeSearch(stage, self.own, self.estimate))

    def search(self) -> None:
        """Forward, the most probable change first; each is looked at again when others have joined."""
        for step in range(_MOST):
            stage = self.stage(self.beside)
            self._step(0.1 + 0.8 * (step + 0.5) / _MOST)
            chosen = self._chosen(stage, ranked(stage))
            if chosen is None:
                break
            effect = chosen[0].hit.effect
            if self.old is not None and chosen[0].hit.candidate not in self.own and self.old.shows(effect, chosen[0], stage):
                self.nuisance.append(effect)
                continue
            self.found.append(chosen)
            self._drop_idle()

    def _chosen(self, stage: Stage, judged: list[Judged]) -> tuple[Judged, tuple[Judged, ...], Array] | None:
        worth = [j for j in judged if not j.against and _surplus(j, stage) > 0 and self._matters(stage, j)]
        if not worth:
            return None
        w = weights(worth, [threshold(j.hit, stage.number) for j in worth])
        order = [int(i) for i in np.argsort(-w)]
        return worth[order[0]], tuple(worth[i] for i in order[1:]), w[order]

    def _matters(self, stage: Stage, judged: Judged) -> bool:
        rows = touched(judged.hit.columns)
        return judged.evidence > _LEAST_SHARE * float(np.sum(stage.frame.residual[rows] ** 2))

    def _drop_idle(self) -> None:
        """Leave out changes that those found later account for."""
        for item in list(self.found):
            if len(self.found) < 2:
                return
            others = [e for e in self.beside if e is not item[0].hit.effect]
            stage = self.stage(others)
            Z = stage.frame.whitened(self.motions.columns(item[0].hit.effect))
            again = Judged(Hit(item[0].hit.candidate, item[0].hit.effect, stage.frame.fit_gain(Z), Z), stage.frame.score(Z), "")
            if _surplus(again, stage) <= 0:
                self.found.remove(item)

    def result(self) -> Monitoring:
        """The answer."""
        frame = self.frame(self.beside)
        values, covariance = frame.changes()
        sizes = [len(e.parameters(self.estimate.model.robot)) for e in self.beside]
        ends = np.cumsum([0, *sizes])
        known = determined(frame)
        total = float(frame.heldout_loss[:-1].sum()) + sum(j.evidence for j, _, _ in self.found)
        changes, torque = [], np.zeros_like(self.whole.tau)
        whole = Motions(Problem(self.estimate.model, self.whole, reference=self.estimate.all_values))
        for item, start in zip(self.found, ends[len(self.nuisance) :], strict=False):
            part = slice(int(start), int(start) + len(item[0].hit.effect.parameters(self.estimate.model.robot)))
            std = np.where(known[part], np.sqrt(np.maximum(np.diag(covariance)[part], 0.0)), np.inf)
            changes.append(self._change(item, values[part], std, total, frame))
            torque += whole.columns(item[0].hit.effect) @ values[part]
        residual = self.estimate.residual(self.whole)
        drifts = self._drifts(frame)
        changes.sort(key=lambda c: -c.evidence)
        verdict = "unchanged" if not changes else "ambiguous" if any(c.ambiguous for c in changes) else "changed"
        self._step(1.0)
        return Monitoring(
            "unexplained" if drifts else verdict,
            tuple(changes),
            drifts,
            self.estimate,
            self.whole,
            TorqueError.of(residual, self.whole.tau),
            TorqueError.of(residual - torque, self.whole.tau),
            residual,
            residual - torque,
            tuple(f"{e.name}{' on ' + ', '.join(e.joints) if e.joints else ''}" for e in self.nuisance),
            self.whole.report.warnings,
        )

    def _change(self, item: tuple[Judged, tuple[Judged, ...], Array], values: Array, std: Array, total: float, frame: KnownFrame) -> Change:
        judged, rivals, weight = item
        candidate, robot = judged.hit.candidate, self.estimate.model.robot
        own = self.own.get(candidate)
        named = own.parameters if own is not None else judged.hit.effect.parameters(robot)
        estimate = self.estimate
        found = []
        for p, v, s in zip(named, values, std, strict=True):
            before = float(estimate.value(p.name)) if own is not None and p.name in estimate.names else None
            found.append(ChangedParameter(p.name.replace("+", ""), float(v), float(s), p.unit, before))
        if own is None:
            found += [
                ChangedParameter(p.name, float(getattr(judged.hit.effect, p.name)), np.inf, p.unit) for p in judged.hit.effect.shape()
            ]
        how = How.CHANGED if own is not None else How.APPEARED
        if own is None and values[0] < 0 and named[0].lower == 0.0:
            how = How.DISAPPEARED
        key = (candidate.name, candidate.joints)
        share: dict[tuple[str, tuple[str, ...]], float] = {key: float(weight[0])}
        for rival, w in zip(rivals, weight[1:], strict=True):
            place = (rival.hit.candidate.name, rival.hit.candidate.joints)
            share[place] = share.get(place, 0.0) + float(w)
        imitators = tuple(
            Imitator(*place, _SUREST * w) for place, w in sorted(share.items(), key=lambda x: -x[1]) if place != key and w >= _NAMED
        )
        gain = float(np.clip(judged.evidence / max(total, 1e-300), 0.0, 1.0))
        return Change(judged.hit.effect, how, candidate.joints, tuple(found), gain, judged.evidence, _SUREST * share[key], imitators[:6])

    def _drifts(self, frame: KnownFrame) -> tuple[Drift, ...]:
        """Whether the parameters as a whole lie where the fit had them, in the doubt of both."""
        from scipy.stats import f

        moved, gain = frame.freed()
        residual = float(np.sum(frame.residual**2))
        chance = frame.own * float(f.isf(FALSE_ALARM, frame.own, frame.freedom(np.ones(len(frame.columns), bool))))
        sure = float(gain.sum()) > _SURE * float(np.sqrt(len(gain)) * gain.std(ddof=1))
        if moved <= chance or moved <= _LEAST_SHARE * residual or not sure:
            return ()
        free = self._free_residual(frame)
        fall = np.sum(frame.residual**2, axis=1) - np.sum(free**2, axis=1)
        names = self.estimate.model.robot.joint_names
        shown = [int(j) for j in np.argsort(-fall) if fall[j] > 0.1 * fall.sum()]
        text = f"parameters moved by more than both logs' doubt (chi-square {moved:.0f} for {frame.own})"
        return tuple(
            Drift(names[j], f"{names[j]}: {text}; refitted, {fall[j] / np.sum(frame.residual[j] ** 2):.0%} of its squared error goes")
            for j in shown
        )

    def _free_residual(self, frame: KnownFrame) -> Array:
        X = frame.columns.reshape(-1, frame.columns.shape[2])
        solution = np.linalg.lstsq(X, frame.torque.reshape(-1), rcond=1e-10)[0]
        return np.asarray(frame.torque - frame.columns @ solution)


def determined(frame: KnownFrame) -> Array:
    """Which of the accepted changes' coefficients the rows tell, (k,) bool."""
    G = frame.gram.sum(axis=0)[:-1, :-1]
    scale = np.sqrt(np.maximum(np.diag(G), 1e-300))
    values, vectors = np.linalg.eigh(G / scale[:, None] / scale)
    lost = vectors[:, values < 1e-10 * values[-1]]
    return np.asarray(np.sum(lost**2, axis=1) < 1e-6)[frame.own :]


class _Reference:
    """The logs of the fit itself: whether they show an effect, too."""

    def __init__(self, estimate: Estimate, signals: Signals) -> None:
        own = without_reversals(signals.without_turning(estimate.sticking))
        self.problem = Problem(estimate.model, own, reference=estimate.all_values)
        self.raw, self.white = raw_columns(self.problem), noise_of(estimate, own)
        self.motions = Motions(self.problem)

    def shows(self, effect: Effect, judged: Judged, stage: Stage) -> bool:
        """Whether an effect of the new logs is as large in the old ones, within the doubt of both and some inexactness."""
        from scipy.stats import chi2

        new, new_covariance = _free_fit(stage.frame.white, stage.problem, raw_columns(stage.problem), stage.motions.columns(effect))
        old, old_covariance = _free_fit(self.white, self.problem, self.raw, self.motions.columns(effect))
        doubt = new_covariance + old_covariance + _INEXACT**2 * (np.outer(new, new) + np.outer(old, old))
        difference = new - old
        apart = float(difference @ np.linalg.pinv(doubt, hermitian=True) @ difference)
        there = float(old @ np.linalg.pinv(old_covariance, hermitian=True) @ old)
        k = len(new)
        return there > float(chi2.isf(FALSE_ALARM, k)) and apart < float(chi2.isf(FALSE_ALARM, k))


#: Laws are never exact: the same effect may come out so differently from one motion to another.
_INEXACT = 0.2


def _free_fit(white: Whitener, problem: Problem, raw: Array, columns: Array) -> tuple[Array, Array]:
    """An effect's coefficients (k,) and covariance beside the freely refitted model."""
    n, k = raw.shape[1], columns.shape[2]
    valid = problem.signals.valid
    every = np.concatenate([raw, columns], axis=2)
    X = np.stack([white(np.where(valid[:, j, None], every[:, j], 0.0), j) for j in range(n)]).reshape(-1, every.shape[2])
    y = np.stack([white(np.where(valid[:, j], problem.signals.tau[:, j], 0.0), j) for j in range(n)]).reshape(-1)
    scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    inverse = np.linalg.pinv((X / scale).T @ (X / scale), rcond=1e-10, hermitian=True)
    values = inverse @ ((X / scale).T @ y) / scale
    return values[-k:], (inverse / scale[:, None] / scale)[-k:, -k:]
