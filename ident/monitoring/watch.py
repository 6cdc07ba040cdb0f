"""Monitoring: what has changed since a fit, estimated from new logs alone, with the doubt of the fit counted in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..diagnosis.result import Imitator
from ..effects.places import on, place_of
from ..errors import ConfigurationError, DataError
from ..problem.problem import Problem, error_on
from .candidates import own_changes
from .frame import KnownFrame, noise_of
from .left import LEAST_SHARE, crowds, drifts, noises, trust, unknown
from .reference import MonitoredFit
from .result import Change, ChangedParameter, How, Monitoring
from .search import ChangeSearch, determined, surplus
from .stages.acceptance import Found
from .stages.analysis import without_reversals
from .stages.bank import Bank
from .stages.candidates import candidates
from .stages.evidence import acts_on, threshold
from .stages.frame import raw_columns
from .stages.motions import Motions
from .stages.search import Hit, Judged, Search
from .stages.selection import ranked
from .stages.stage import Stage
from .stages.weights import weights

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray
_MOST = 8
#: Rivals less probable than this are not named; nothing is surer than the upper bound, for the catalogue may lack the true one.
_NAMED, _SUREST = 0.01, 0.99
#: What is left of the confidence in one of too many changes on a joint.
_CROWDED = 0.4


def monitor(
    estimate: Estimate, signals: Signals, *, reference: Signals | None = None, progress: Callable[[float], None] | None = None
) -> Monitoring:
    """Compare new logs with a saved fit, and say what has changed.

    Parameters
    ----------
    estimate : Estimate
        The fit.
    signals : Signals
        The new logs, prepared like those of the fit (`ident.study.session.like(estimate.signals_config)`).
    reference : Signals, optional
        The logs of the fit itself, prepared likewise; with them an effect that the model never had is distinguished from a new one.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    Monitoring
        Parameters that changed, with significance, and what the model does not explain.

    Raises
    ------
    ConfigurationError
        Another robot.
    DataError
        Too few rows.

    Examples
    --------
    >>> import ident
    >>> from ident.study.session import like
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> found = ident.monitor(estimate, like(estimate.signals_config)(test, ident.load_robot("puma560")))
    >>> found.changes
    ()
    """
    if signals.robot.joint_names != estimate.model.robot.joint_names:
        raise ConfigurationError(
            f"the logs are of a robot with the joints {', '.join(signals.robot.joint_names)}; the fit has"
            f" {', '.join(estimate.model.robot.joint_names)}."
        )
    watch = _Watch(estimate, signals, reference, progress)
    watch.search()
    return watch.result()


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
        self.candidates = (*self.own, *candidates(estimate.model, self.motions))
        self.bank = Bank()
        self.found: list[Found] = []
        self.nuisance: list[Effect] = []
        self.old = None if reference is None else MonitoredFit(estimate, reference)
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
        return [*self.nuisance, *(found.effect for found in self.found)]

    def stage(self, effects: Sequence[Effect]) -> Stage:
        """Everything that scores candidates beside effects."""
        frame = self.frame(effects)
        plain = Search(frame, self.motions, self.candidates, self.bank)
        stage = Stage(self.problem, frame.white, frame, self.motions, plain)
        return Stage(self.problem, frame.white, frame, self.motions, ChangeSearch(stage, self.own, self.estimate))

    def search(self) -> None:
        """Forward, the most probable change first; each is looked at again when others have joined."""
        for step in range(_MOST):
            stage = self.stage(self.beside)
            self._step(0.1 + 0.8 * (step + 0.5) / _MOST)
            chosen = self._chosen(stage, ranked(stage))
            if chosen is None:
                break
            effect = chosen.effect
            if self.old is not None and chosen.judged.hit.candidate not in self.own and self.old.shows(effect, stage):
                self.nuisance.append(effect)
                continue
            self.found.append(chosen)
            self._drop_idle()

    def _chosen(self, stage: Stage, judged: list[Judged]) -> Found | None:
        worth = [j for j in judged if not j.against and surplus(j, stage) > 0 and self._matters(stage, j)]
        if not worth:
            return None
        w = weights(worth, [threshold(j.hit, stage.number) for j in worth])
        order = [int(i) for i in np.argsort(-w)]
        return Found(worth[order[0]], tuple(worth[i] for i in order[1:]), w[order])

    def _matters(self, stage: Stage, judged: Judged) -> bool:
        rows = acts_on(judged)
        return judged.evidence > LEAST_SHARE * float(np.sum(stage.frame.residual[rows] ** 2))

    def _drop_idle(self) -> None:
        """Leave out changes that those found later account for."""
        for item in list(self.found):
            if len(self.found) < 2:
                return
            others = [e for e in self.beside if e is not item.effect]
            stage = self.stage(others)
            Z = stage.frame.whitened(self.motions.columns(item.effect))
            again = Judged(Hit(item.judged.hit.candidate, item.effect, stage.frame.fit_gain(Z), Z), stage.frame.score(Z), "")
            if surplus(again, stage) <= 0:
                self.found.remove(item)

    def result(self) -> Monitoring:
        """The answer."""
        stage = self.stage(self.beside)
        frame = stage.frame
        assert isinstance(frame, KnownFrame)
        values, covariance = frame.changes()
        sizes = [len(e.parameters(self.estimate.model.robot)) for e in self.beside]
        ends = np.cumsum([0, *sizes])
        known = determined(frame)
        total = float(frame.heldout_loss[:-1].sum()) + sum(found.judged.evidence for found in self.found)
        changes, torque = [], np.zeros_like(self.whole.tau)
        whole = Motions(Problem(self.estimate.model, self.whole, reference=self.estimate.all_values))
        crowded = crowds([found.effect for found in self.found if found.judged.hit.candidate not in self.own])
        for item, start in zip(self.found, ends[len(self.nuisance) :], strict=False):
            part = slice(int(start), int(start) + len(item.effect.parameters(self.estimate.model.robot)))
            std = np.where(known[part], np.sqrt(np.maximum(np.diag(covariance)[part], 0.0)), np.inf)
            change = self._change(item, values[part], std, total, frame)
            if {c.joint for c in crowded} & set(change.joints):
                change = replace(change, confidence=_CROWDED * change.confidence)
            changes.append(change)
            torque += whole.columns(item.effect) @ values[part]
        residual = self.estimate.residual(self.whole)
        unexplained = (*unknown(self.estimate, self.whole), *drifts(frame), *noises(stage, tuple(self.found)), *crowded)
        changes.sort(key=lambda c: -c.evidence)
        verdict = "unchanged" if not changes else "ambiguous" if any(c.ambiguous for c in changes) else "changed"
        self._step(1.0)
        return Monitoring(
            "unexplained" if unexplained else verdict,
            tuple(changes),
            unexplained,
            self.estimate,
            self.whole,
            error_on(self.whole, residual, raw=False),
            error_on(self.whole, residual - torque, raw=False),
            residual,
            residual - torque,
            tuple(f"{e.name}{on(place_of(e))}" for e in self.nuisance),
            self.whole.report.warnings,
        )

    def _change(self, item: Found, values: Array, std: Array, total: float, frame: KnownFrame) -> Change:
        candidate, robot, estimate = item.judged.hit.candidate, self.estimate.model.robot, self.estimate
        own = self.own.get(candidate)
        named = own.parameters if own is not None else item.effect.parameters(robot)
        parameters = []
        for p, v, s in zip(named, values, std, strict=True):
            before = float(estimate.value(p.name)) if own is not None and p.name in estimate.names else None
            parameters.append(ChangedParameter(p.name.replace("+", ""), float(v), float(s), p.unit, before))
        if own is None:
            shapes = [(p.name, float(getattr(item.effect, p.name)), item.effect.shape_unit(p, robot)) for p in item.effect.shape()]
            parameters += [ChangedParameter(name, value, np.inf, unit) for name, value, unit in shapes]
        how = How.CHANGED if own is not None else How.APPEARED
        if own is None and values[0] < 0 and named[0].lower == 0.0:
            how = How.DISAPPEARED
        key = (candidate.name, candidate.joints)
        share: dict[tuple[str, tuple[str, ...]], float] = {key: item.weight}
        for rival, w in zip(item.rivals, item.weights[1:], strict=True):
            place = (rival.hit.candidate.name, rival.hit.candidate.joints)
            share[place] = share.get(place, 0.0) + float(w)
        believed = _SUREST * trust(frame, acts_on(item.judged), item.judged.evidence)
        imitators = tuple(
            Imitator(*place, believed * w) for place, w in sorted(share.items(), key=lambda x: -x[1]) if place != key and w >= _NAMED
        )
        return Change(
            effect=item.effect,
            joints=candidate.joints,
            parameters=tuple(parameters),
            heldout_gain=float(np.clip(item.judged.evidence / max(total, 1e-300), 0.0, 1.0)),
            evidence=item.judged.evidence,
            confidence=believed * share[key],
            imitators=imitators[:6],
            how=how,
        )
