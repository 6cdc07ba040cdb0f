"""`diagnose_drives`: candidate effects simulated in the loop, decided by fits beside each other and by readings held out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..._utils.threads import with_one_blas_thread
from ...drives.fit import notes_of, result_of, scale_of_gains
from ...drives.plant import DrivePlant
from ...drives.residual import FORETOLD, left_over, more_than_noise, require_motion, sizes_told, too_large
from ...drives.search import fitted
from ...drives.sizes import doubtful_sizes, impossible
from ...drives.space import drive_logs
from ...drives.starts import moved_inertia, starts
from ...drives.stretches import shares, steadied, unexplained
from ..verdict import Verdict
from .candidates import same_motion
from .improved import from_afar, reweighed
from .otherwise import Otherwise, otherwise
from .result import DriveDiagnosis, DriveFinding, DriveRival
from .revision import ALIKE, Accepted, needed, with_rivals
from .screening import Screened, screened
from .trials import Stage, believed, settled, tried

if TYPE_CHECKING:
    from ...drives.law import DriveLaw
    from ...drives.result import DriveFit
    from ...logs.log import LogSet
    from ...model import Model

Array = np.ndarray
#: Findings at most, candidates that are tried for each, and rounds in which one is found, since others may go as needless.
_FINDINGS, _FITTED, _ROUNDS = 3, 8, 6
#: What is said of findings that make the error larger where they were not sought.
_WORSE = (
    "the error of simulated position on held-out data is larger with what was found than without: it describes the fitted data and holds no"
    " further; its cause is another one."
)


@with_one_blas_thread
def diagnose_drives(
    logs: LogSet, model: Model, law: DriveLaw, *, held: LogSet | None = None, progress: Callable[[float], None] | None = None
) -> DriveDiagnosis:
    """What a declared model and drive law lack, by the positions that the logged commands lead to in simulation.

    Parameters
    ----------
    logs : LogSet
        Logs with positions and commands.
    model : Model
        Rigid body and declared effects.
    law : DriveLaw
        The declared law: what it gives as a number (kp, delay) is doubted, what is to be identified is not.
    held : LogSet, optional
        Logs to report the error before and after on.

    Returns
    -------
    DriveDiagnosis
    """
    plant = DrivePlant(model, law, drive_logs(logs, model.robot, law))
    require_motion(plant)
    at, sizes = starts(plant)
    # Stretches in which something else happened count the less throughout: nothing is found by what it makes of a contact.
    first = Stage(plant, steadied(plant, fitted(plant, at, sizes, progress=progress), sizes), sizes)
    now, others, accepted = _sought(first)
    before, after = (result_of(stage.plant, stage.fit, stage.sizes, logs.inputs) for stage in (first, now))
    findings = [*(other.finding(after) for other in others), *(_in_the_end(one.finding, after) for one in accepted)]
    left, rest = left_over(now.plant, now.fit), left_over(now.plant, now.fit, shares(now.plant, now.fit.weights))
    if held is not None:
        before, after = before.with_heldout(held, logs), after.with_heldout(held, logs)
    worse = bool(findings) and _worse(before, after)
    told = tuple(one.text(model.robot.joint_names[one.joint]) for one in unexplained(now.plant, now.fit))
    large = too_large(now.plant, now.fit)
    sizes_of = (sizes_told(now.plant, now.fit, large),) if large.any() else ()
    warnings = (*scale_of_gains(now.plant), *notes_of(now.plant), *told, *sizes_of)
    verdict = Verdict.UNEXPLAINED if worse or more_than_noise(now.plant, now.fit) else _verdict(findings, after)
    return DriveDiagnosis(verdict, tuple(findings), left, before, after, (*warnings, *([_WORSE] if worse else [])), rest)


def _sought(first: Stage) -> tuple[Stage, list[Otherwise], list[Accepted]]:
    """The model with what is missing, fitted, and what that is: what is otherwise than it is declared without a number, and candidates, one
    after another. `first`: as declared."""
    declared = now = first
    inertia, accepted, others = moved_inertia(first.plant), list[Accepted](), list[Otherwise]()
    afar = True
    for number in range(_ROUNDS):
        if len(accepted) == _FINDINGS:
            break
        quick = now.quickened()
        found = [tried(quick, one, inertia) for one in screened(quick.plant, quick.fit, inertia)[:_FITTED]]
        better = believed(quick, [one for one in found if one is not None])
        ends = [end for one, stage in better if (end := settled(quick, one, stage, first.plant.step, inertia)) is not None]
        if len(others) == number and (other := otherwise(now, ends)) is not None:
            declared = now = reweighed(other.stage)
            others.append(other)
            continue
        if not ends:
            break
        ends, afar = from_afar(now, ends) if afar else (ends, False)
        new, now = _decided(now, ends)
        accepted, now = needed(declared.plant, now, [*accepted, new])
        if new not in accepted:
            break
    return now, others, with_rivals(declared.plant, now, accepted, inertia)


def _worse(before: DriveFit, after: DriveFit) -> bool:
    """Whether data held out contradict what was found: their error is larger with it, in units of each joint's own without it."""
    if before.heldout_rms is None or after.heldout_rms is None:
        return False
    return bool(np.mean(np.square(after.heldout_rms / np.maximum(before.heldout_rms, 1e-12))) > 1.0 + FORETOLD)


def _decided(now: Stage, found: list[tuple[Screened, Stage]]) -> tuple[Accepted, Stage]:
    """The best of them, with those that explain as much."""
    found = sorted(found, key=lambda pair: pair[1].fit.cost)
    (one, stage), others = found[0], found[1:]
    plant = stage.plant
    behind = np.array([(other[1].fit.cost - stage.fit.cost) / stage.fit.spread for other in others])
    odds = np.exp(-0.5 * np.minimum(behind, 1e3))
    same = same_motion(one.candidate, one.joints, now.plant.law, plant, stage.fit.values)
    confidence = 1.0 / (1.0 + len(same) + float(odds.sum()))
    alike = [(other, float(odd)) for (other, _), odd, far in zip(others, odds, behind, strict=True) if far < ALIKE]
    rivals = tuple(DriveRival(name, _names(plant, one), confidence) for name in same) + tuple(
        DriveRival(other.candidate.name, _names(plant, other), odd * confidence) for other, odd in alike if other.candidate.name not in same
    )
    before = {u.name for u in now.plant.unknowns}
    values = tuple(
        (u.name, float(v), np.inf, u.unit) for u, v in zip(plant.unknowns, stage.fit.values, strict=True) if u.name not in before
    )
    declared = None
    if one.candidate.place in now.plant.law.constants and one.candidate.either_way:
        declared = tuple(one.candidate.declared(now.plant.law, j) for j in one.joints)
    joints = tuple(plant.robot.joint_names) if one.candidate.of_all else _names(plant, one)
    least = tuple(float(u.lower) for u in plant.unknowns if u.name not in before)
    finding = DriveFinding(one.candidate.name, joints, values, declared, one.gain, confidence, rivals, (), least)
    return Accepted(one, finding, tuple(other for other, _ in alike)), reweighed(stage)


def _in_the_end(finding: DriveFinding, after: DriveFit) -> DriveFinding:
    """A finding with its values beside all that was found later."""
    doubts = doubtful_sizes(after.unknowns, after.values, after.covariance)
    at = [after.names.index(name) for name, *_ in finding.values]
    std = [np.inf if i in doubts else float(np.sqrt(after.covariance[i, i])) for i in at]
    values = tuple((after.names[i], float(after.values[i]), s, after.unknowns[i].unit) for i, s in zip(at, std, strict=True))
    return replace(finding, values=values, no_size=tuple(text for i, text in doubts.items() if i in at))


def _names(plant: DrivePlant, one: Screened) -> tuple[str, ...]:
    return tuple(plant.robot.joint_names[j] for j in one.joints)


def _verdict(findings: list[DriveFinding], after: DriveFit) -> Verdict:
    told = {name for finding in findings for name, *_ in finding.values}
    absurd = any(impossible(u, float(v)) for u, v in zip(after.unknowns, after.values, strict=True) if u.name in told)
    if absurd:
        return Verdict.UNEXPLAINED
    if not findings:
        return Verdict.CLEAN
    return Verdict.AMBIGUOUS if any(finding.rivals or finding.no_size for finding in findings) else Verdict.EXPLAINED
