"""A model with values of all its parameters, and the drive law's constants where it has one: what every export is written from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drives.result import DriveFit
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError, UnsupportedError
from ..physical.bounds import Bounds, Metric, reference_prior
from ..physical.conic import InfeasibleError
from ..physical.pseudo_inertia import centre_of_mass
from ..physical.standard import StandardParameters, standard_parameters
from ..physical.structure import InertiaStructure
from ..robots.parameters import LINK_SYMBOLS
from ..robots.tree import link_names
from .closed_loop import ClosedLoop

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..model import Model
    from ..robots.robot import Robot

Array = np.ndarray

#: Effects that the formats know, with the name MuJoCo gives them.
DRIVE = {"rotor_inertia": "armature", "viscous": "damping", "coulomb": "frictionloss"}


@dataclass(frozen=True, eq=False)
class Identified:
    """A model with values of all its k parameters, ready to be exported. `inertial` (10 nb,) links; `notes`: how they were found;
    `undetermined`: names of parameters of the drive that the data did not determine (they stand at zero); `law`: constants of
    the drive law, None for a fit of measured torque; `fit`: what the values come from, where that is known."""

    model: Model
    values: Array
    notes: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()
    law: ClosedLoop | None = None
    fit: Estimate | DriveFit | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls,
        source: Estimate | StandardParameters | DriveFit | Identified,
        *,
        model: Model | None = None,
        metric: Metric | str = Metric.ENTROPIC,
        bounds: Bounds | None = None,
        supply: float | None = None,
    ) -> Identified:
        """From an estimate or a fit under a drive law, whose standard parameters are sought nearest to the URDF's own in `metric`, or
        from standard parameters.

        Standard parameters need their `model`, a pwm law the voltage `supply` (V) at which its gains are told.

        Raises ConfigurationError where no real links give the base parameters."""
        if isinstance(source, Identified):
            return source
        if isinstance(source, DriveFit):
            return _of_drives(source, metric, bounds, supply)
        if isinstance(source, StandardParameters):
            if model is None:
                raise ConfigurationError("to export standard parameters, give their model too: model=.")
            return cls(model, source.values, source.notes)
        structure = InertiaStructure.from_model(source.model, source.base)
        values, notes = _real_links(source.model, structure, source.values, source.covariance, metric, bounds)
        return cls(source.model, *_without_undetermined(source, values, notes), fit=source)

    @classmethod
    def plain(cls, source: Estimate | DriveFit | Identified, *, supply: float | None = None) -> Identified:
        """From any of these, with links that give the torque, which need not be real bodies."""
        if isinstance(source, Identified):
            return source
        if isinstance(source, DriveFit):
            return cls(source.model, _values(source), _together(source), law=ClosedLoop.of(source, supply), fit=source)
        return cls(source.model, source.all_values, fit=source)

    @property
    def robot(self) -> Robot:
        return self.model.robot

    @property
    def inertial(self) -> Array:
        """Inertial parameters (10 nb,) of the moving bodies, in Pinocchio's order."""
        part = next(s for e, s in zip(self.model.effects, self.model.slices, strict=True) if isinstance(e, RigidBody))
        return self.values[part]

    def drive(self) -> dict[str, Array]:
        """ "armature", "damping", "frictionloss" -> (n,) on the motor side, zero where the model has none (kg m^2, N m s/rad, N m).

        The back-EMF of a drive law damps, and is in "damping"."""
        found = self._drive(self.values, "motor")
        if self.law is not None:
            found["damping"] = found["damping"] + self.law.back_emf
        return found

    def beside(self) -> dict[str, Array]:
        """The same of effects that are declared on the joint side."""
        return self._drive(self.values, "joint")

    def identified(self) -> dict[str, Array]:
        """For each of `drive` (n,) bool: where the model has it and the data determined it."""
        known = np.array([p.name not in self.undetermined for p in self.model.parameters], float)
        return {key: values > 0 for key, values in self._drive(known, "motor").items()}

    def _drive(self, of: Array, side: str) -> dict[str, Array]:
        robot = self.robot
        out = {key: np.zeros(robot.n) for key in DRIVE.values()}
        for effect, part in zip(self.model.effects, self.model.slices, strict=True):
            if effect.side.value != side:
                continue
            if effect.name in DRIVE:
                out[DRIVE[effect.name]][effect.at(robot)] += of[part]
            elif effect.name == "joint_side_friction":
                at = effect.at(robot)
                dry, viscous = np.asarray(of[part]).reshape(len(at), 2).T
                out["frictionloss"][at] += dry
                out["damping"][at] += viscous
        return out

    def left_out(self) -> tuple[str, ...]:
        """Names of effects that no exported model format can hold."""
        return tuple(e.name for e in self.model.effects if e.name != "rigid_body" and not (e.name in DRIVE and e.side.value == "motor"))

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data (`ident.parameters/1`): links, drive, every parameter by name, constants of the drive law."""
        robot = self.robot

        links = []
        joints = (("floating base",) if robot.floating_base else ()) + tuple(j.name for j in robot.tree_joints)
        for name, joint, row in zip(link_names(robot.model), joints, self.inertial.reshape(-1, 10), strict=True):
            link: dict[str, Any] = {"link": name, "joint": joint, "parameters": dict(zip(LINK_SYMBOLS, row.tolist(), strict=True))}
            if row[0] > 0:
                mass, com, inertia = centre_of_mass(row)
                link |= {"mass": mass, "centre_of_mass": com.tolist(), "inertia_about_centre_of_mass": inertia.tolist()}
            links.append(link)
        return {
            "robot": robot.name,
            "gravity": robot.tree.gravity.tolist(),
            "joints": list(robot.joint_names),
            "transmission": {
                "K": robot.transmission.K.tolist(),
                "zero": robot.transmission.zero.tolist(),
                "measured": robot.transmission.measured.value,
            },
            "links": links,
            "drive": {key: values.tolist() for key, values in self.drive().items()},
            "parameters": [
                {"name": p.name, "value": float(v), "unit": p.unit, "effect": p.effect, "joint": p.joint}
                for p, v in zip(self.model.parameters, self.values, strict=True)
            ],
            **({} if self.law is None else {"law": self.law.to_dict()}),
            "notes": list(self.notes),
        }


def _real_links(
    model: Model, structure: InertiaStructure, values: Array, covariance: Array | None, metric: Metric | str, bounds: Bounds | None
) -> tuple[Array, tuple[str, ...]]:
    """All parameters (k,) with real links that give base values (b,), and notes."""
    prior, notes = reference_prior(model.robot, structure, metric)
    try:
        found = standard_parameters(structure, values, prior=prior, bounds=bounds, covariance=covariance)
    except InfeasibleError as error:
        raise ConfigurationError(
            f"nothing was exported: {error} A fit with method 'physical' (--method physical) is consistent from the start;"
            " `ident judge FIT --repair fit --out DIR` makes a saved one so."
        ) from None
    return found.values, notes + found.notes


def _of_drives(fit: DriveFit, metric: Metric | str, bounds: Bounds | None, supply: float | None) -> Identified:
    found, law, model = _values(fit), ClosedLoop.of(fit, supply), fit.model
    if fit.law.links_known:
        return Identified(model, found, _together(fit), law=law, fit=fit)
    structure = InertiaStructure.from_model(model, model.base)
    values, notes = _real_links(model, structure, found[model.base.independent], None, metric, bounds)
    return Identified(model, values, _together(fit) + notes, law=law, fit=fit)


def _values(fit: DriveFit) -> Array:
    """All parameters (k,) with which a fit under a drive law is simulated; those grouped in others zero."""
    model = fit.model
    values = np.zeros(len(model.parameters))
    for unknown, value in zip(fit.unknowns, fit.values, strict=True):
        if unknown.column >= 0:
            values[unknown.column] = value
    if fit.law.links_known:
        if model.robot.nominal is None:
            raise UnsupportedError(f"the URDF of robot {model.robot.name!r} has no inertials to export.")
        part = next(s for e, s in zip(model.effects, model.slices, strict=True) if isinstance(e, RigidBody))
        values[part] = model.robot.nominal
    return values


def _together(fit: DriveFit) -> tuple[str, ...]:
    if fit.determination is None:
        return ()
    found = (*fit.determination.combinations, *fit.determination.bounded)
    said = [f"{'determined only in combination' if c.determined else 'not determined'}: {c.expression}" for c in found]
    return tuple(f"{text}; the file holds one of the sets of values that give the same motion." for text in said)


def _without_undetermined(source: Estimate, values: Array, notes: tuple[str, ...]) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
    """Values, notes and names, where parameters of the drive that no base parameter of the estimate holds are put to zero: any value of
    theirs gives the same torque, so that what a search for real links left there means nothing."""
    blind = ~np.any(source.base.regroup != 0.0, axis=0)
    at = [i for i, p in enumerate(source.model.parameters) if p.effect in DRIVE and (blind[i] or p.name in source.dropped)]
    if not at:
        return values, notes, ()
    values = values.copy()
    values[at] = 0.0
    names = tuple(source.model.parameters[i].name for i in at)
    said = f"not determined by the data, and exported as zero (a URDF keeps its own values): {', '.join(names)}."
    return values, (*notes, said), names
