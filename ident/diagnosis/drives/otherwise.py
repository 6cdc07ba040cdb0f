"""What is declared without a number, and may be otherwise: velocities that were sent but not logged, what happens between two commands,
and links that are not the URDF's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...drives.fit import result_of
from ...drives.folds import held_out
from ...drives.given import CommandForm, VelocityCommand
from ...drives.law import DriveLaw
from ...drives.nearby import approached, refitted
from ...drives.plant import DrivePlant
from ...drives.residual import more_than_noise
from ...drives.result import DriveFit
from ...drives.search import begun, derivatives
from ...drives.starts import starts
from .improved import any_leaves_noise, reweighed
from .result import LINKS, RAMP, STAIRCASE, VELOCITY_COMMAND, DriveFinding
from .screening import SIGNIFICANT, Screened
from .trials import STEPS, Stage

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Otherwise:
    """A model that is otherwise than the one `before` in `effect`, both fitted. `changed`: names of the links' parameters that are others
    than the URDF's, with those (kg m, kg m²)."""

    effect: str
    before: Stage
    stage: Stage
    changed: Mapping[str, float]

    def finding(self, after: DriveFit) -> DriveFinding:
        """What is otherwise. `after`: the fit with this, and all that was found beside it."""
        before, now = (np.nansum(held_out(s.plant, s.fit, s.sizes).squares) for s in (self.before, self.stage))
        gain, names = 1.0 - float(now / before), after.model.robot.joint_names
        if not self.changed:
            return DriveFinding(self.effect, tuple(names), (), None, gain, 1.0, ())
        at = [after.names.index(name) for name in self.changed]
        joints = tuple(joint for joint in names if any(name.endswith(f"_{joint}") for name in self.changed))
        values = tuple(
            (after.unknowns[i].expression, float(after.values[i]), float(np.sqrt(after.covariance[i, i])), after.unknowns[i].unit)
            for i in at
        )
        return DriveFinding(self.effect, joints, values, tuple(self.changed.values()), gain, 1.0, ())


def otherwise(first: Stage, ends: list[tuple[Screened, Stage]]) -> Otherwise | None:
    """What explains the error of the fit as declared better than any candidate does, None where nothing does. `ends`: models with a
    candidate each, fitted with the weights of the one without.

    Other forms of the commands have no unknown more, and are held against candidates by the error; all links' parameters have many, and
    are asked for where nothing else leaves noise."""
    lacking = more_than_noise(first.plant, first.fit) and not any_leaves_noise(ends)
    forms = [form for form in (_with_velocities(first.plant), _with_other_command(first.plant)) if form is not None]
    least = min((end.fit.cost for _, end in ends), default=first.fit.cost)
    fitted = ((effect, _fitted(first, plant, least, _starts(plant) if lacking else [])) for effect, plant in forms)
    best = min((Otherwise(effect, first, stage, {}) for effect, stage in fitted if stage), key=lambda one: one.stage.fit.cost, default=None)
    if best is not None and not least - best.stage.fit.cost > SIGNIFICANT**2 * best.stage.fit.spread:
        best = None
    if not lacking or (best is not None and not more_than_noise(best.stage.plant, best.stage.fit)):
        return best
    return _with_free_links(first) or best


def _with_velocities(plant: DrivePlant) -> tuple[str, DrivePlant] | None:
    """With the derivatives of position commands sent beside them, where no velocity command is logged."""
    law, logs = plant.law, plant.logs
    if law.kind != "pd_position" or any(np.any(log.dq_cmd) for log in logs) or not np.any(law.constants["kd"] != 0.0) or _by_log(law):
        return None
    sent = tuple(replace(log, dq_cmd=np.gradient(log.q_cmd, log.t, axis=0)) for log in logs)
    return VELOCITY_COMMAND, replace(plant, logs=sent, law=replace(law, velocity_command=VelocityCommand.DERIVATIVE))


def _with_other_command(plant: DrivePlant) -> tuple[str, DrivePlant] | None:
    """With commands that go straight from one to the next where they are declared to be held, and held where they are not."""
    if _by_log(plant.law):
        return None
    form, name = (CommandForm.RAMP, RAMP) if plant.law.command == CommandForm.STAIRCASE else (CommandForm.STAIRCASE, STAIRCASE)
    return name, replace(plant, law=replace(plant.law, command=form))


def _by_log(law: DriveLaw) -> bool:
    """Whether the forms of commands are given log by log: those are known."""
    return any(table["forms"] for table in law.by_log.values())


def _starts(plant: DrivePlant) -> list[Array]:
    """Where a fit's coarse search from every start ends, (p,)."""
    return [begun(plant, *starts(plant))]


def _fitted(first: Stage, plant: DrivePlant, least: float, further: list[Array]) -> Stage | None:
    """A plant with the same unknowns, fitted with the weights of the first from its values on and from `further` ones (p,). None where few
    steps do not come below a cost of `least`."""
    weights, sizes, everything = first.fit.weights, first.sizes, np.arange(len(first.sizes))
    ends = [first.fit.values, *further]
    near = [approached(plant, at, sizes, weights, derivatives(plant, at, sizes, everything)) for at in ends]
    best = min(near, key=lambda fit: fit.cost)
    if not best.cost < least:
        return None
    return Stage(plant, refitted(plant, best.values, sizes, weights, best.slopes, steps=STEPS), sizes)


def _with_free_links(first: Stage) -> Otherwise | None:
    """With the links' parameters to be identified, if that leaves no more than noise; not where gains are unknown, whose scale is that of
    the links, or where springs part the links of joints from their rotors."""
    plant, law = first.plant, first.plant.law
    if not law.links_known or any(u.place in law.scales for u in plant.unknowns) or np.isfinite(law.constants["joint_stiffness"]).any():
        return None
    free = replace(plant, law=replace(law, links_known=False))
    _, sizes = starts(free)
    at = _as_declared(plant, free, first.fit.values)
    near, everything = replace(first.fit, values=at), np.arange(len(at))
    # So many unknowns make a search to the end long: it goes on while a few steps, from derivatives made anew, halve the error.
    while True:
        before = near.cost
        near = approached(free, near.values, sizes, first.fit.weights, derivatives(free, near.values, sizes, everything), steps=STEPS)
        if not more_than_noise(free, near):
            break
        if not near.cost < 0.5 * before:
            return None
    stage = reweighed(Stage(free, near, sizes))
    changed = _changed(stage, at)
    return Otherwise(LINKS, first, stage, changed) if changed and not more_than_noise(free, stage.fit) else None


def _as_declared(plant: DrivePlant, free: DrivePlant, values: Array) -> Array:
    """Values (p,) of the plant with free links at which they are the URDF's, and all else is as fitted (values of `plant`)."""
    model, known = free.model, {u.name: float(v) for u, v in zip(plant.unknowns, values, strict=True)}
    whole = np.zeros(len(model.parameters))
    whole[: len(plant.nominal)] = plant.nominal
    for unknown, value in zip(plant.unknowns, values, strict=True):
        if unknown.column >= 0:
            whole[unknown.column] = value
    base = dict(zip((int(i) for i in model.base.independent), model.base.regroup @ whole, strict=True))
    return np.array([base[u.column] if u.column >= 0 else known[u.name] for u in free.unknowns])


def _changed(stage: Stage, declared: Array) -> dict[str, float]:
    """Parameters of links alone that differ from the URDF's (p,) by more than chance, with those; a sum with a rotor says nothing of it."""
    model, fit = stage.plant.model, result_of(stage.plant, stage.fit, stage.sizes)
    far = np.abs(fit.values - declared) > SIGNIFICANT * np.sqrt(np.diag(fit.covariance))
    of_links = ~np.any(model.base.regroup[:, len(stage.plant.nominal) :], axis=1)
    alone = {int(column) for column, own in zip(model.base.independent, of_links, strict=True) if own}
    return {u.name: float(declared[i]) for i, u in enumerate(fit.unknowns) if u.place == "link" and u.column in alone and far[i]}
