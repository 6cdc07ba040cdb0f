"""Hand an identified robot on: URDF patched in place, MJCF, JSON, or a plain dictionary.

What is exported are standard parameters: real links that give the identified base parameters exactly (nearest to the URDF's own
where it has any). An estimate that no real links can give is refused with what to do about it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.files import write_atomic
from .._utils.json import jsonable
from .._utils.version import __version__
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError, unknown_name
from ..physical.bounds import Bounds, Metric, reference_prior
from ..physical.conic import InfeasibleError
from ..physical.pseudo_inertia import centre_of_mass, smallest_eigenvalues
from ..physical.standard import StandardParameters, standard_parameters
from ..physical.structure import InertiaStructure
from ..robots.parameters import LINK_SYMBOLS
from ..robots.tree import link_names
from .mjcf import mjcf_text
from .urdf import Attached, BodyExport, patch_urdf, source_text

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..model import Model
    from ..robots.robot import Robot

Array = np.ndarray

FORMATS = ("urdf", "mjcf", "json")
#: Motor-side effects that the formats know, with the name MuJoCo gives them.
_DRIVE = {"rotor_inertia": "armature", "viscous": "damping", "coulomb": "frictionloss"}


@dataclass(frozen=True, eq=False)
class Identified:
    """A model with values of all its k parameters, ready to be exported. `inertial` (10 nb,) links; `notes`: how they were found;
    `undetermined`: names of parameters of the drive that the estimate's data did not determine (they stand at zero)."""

    model: Model
    values: Array
    notes: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        source: Estimate | StandardParameters,
        *,
        model: Model | None = None,
        metric: Metric | str = Metric.ENTROPIC,
        bounds: Bounds | None = None,
    ) -> Identified:
        """From an estimate, whose standard parameters are sought nearest to the URDF's own in `metric`, or from standard parameters.

        Standard parameters need their `model`.

        Raises ConfigurationError where no real links give the estimate's base parameters."""
        if isinstance(source, StandardParameters):
            if model is None:
                raise ConfigurationError("standard parameters are exported with their model: give model=.")
            return cls(model, source.values, source.notes)
        structure = InertiaStructure.from_model(source.model, source.base)
        prior, notes = reference_prior(source.model.robot, structure, metric)
        try:
            found = standard_parameters(structure, source.values, prior=prior, bounds=bounds, covariance=source.covariance)
        except InfeasibleError as error:
            raise ConfigurationError(
                f"nothing was exported: {error} A fit with method='physical' is consistent from the start;"
                " `ident judge FIT --repair fit --out DIR` makes a saved one so."
            ) from None
        return cls(source.model, *_without_undetermined(source, found.values, notes + found.notes))

    @property
    def robot(self) -> Robot:
        return self.model.robot

    @property
    def inertial(self) -> Array:
        """Inertial parameters (10 nb,) of the moving bodies, in Pinocchio's order."""
        part = next(s for e, s in zip(self.model.effects, self.model.slices, strict=True) if isinstance(e, RigidBody))
        return self.values[part]

    def drive(self) -> dict[str, Array]:
        """ "armature", "damping", "frictionloss" -> (n,) on the motor side, zero where the model has none (kg m^2, N m s/rad, N m)."""
        return self._drive(self.values)

    def identified(self) -> dict[str, Array]:
        """For each of `drive` (n,) bool: where the model has it and the data determined it."""
        known = np.array([p.name not in self.undetermined for p in self.model.parameters], float)
        return {key: values > 0 for key, values in self._drive(known).items()}

    def _drive(self, of: Array) -> dict[str, Array]:
        robot = self.robot
        out = {key: np.zeros(robot.n) for key in _DRIVE.values()}
        for effect, part in zip(self.model.effects, self.model.slices, strict=True):
            if effect.name not in _DRIVE or effect.side.value != "motor":
                continue
            out[_DRIVE[effect.name]][effect.at(robot)] = of[part]
        return out

    def left_out(self) -> tuple[str, ...]:
        """Names of effects that no exported model format can hold."""
        return tuple(e.name for e in self.model.effects if e.name != "rigid_body" and not (e.name in _DRIVE and e.side.value == "motor"))

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data (`ident.parameters/1`): links, drive, every parameter by name."""
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
            "notes": list(self.notes),
        }


def _without_undetermined(source: Estimate, values: Array, notes: tuple[str, ...]) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
    """Values, notes and names, where parameters of the drive that no base parameter of the estimate holds are put to zero: any value of
    theirs gives the same torque, so that what a search for real links left there means nothing."""
    blind = ~np.any(source.base.regroup != 0.0, axis=0)
    at = [i for i, p in enumerate(source.model.parameters) if p.effect in _DRIVE and (blind[i] or p.name in source.dropped)]
    if not at:
        return values, notes, ()
    values = values.copy()
    values[at] = 0.0
    names = tuple(source.model.parameters[i].name for i in at)
    said = f"not determined by the data, and exported as zero (a URDF keeps what it says): {', '.join(names)}."
    return values, (*notes, said), names


@dataclass(frozen=True)
class Exported:
    """What was written: `path`, `format`, the moving `bodies` (URDF) and `notes`."""

    path: str
    format: str
    bodies: tuple[BodyExport, ...]
    notes: tuple[str, ...]

    def text(self) -> str:
        """A few lines for people."""
        return "\n".join([f"{self.path}: {self.format} written", *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "path": self.path,
            "format": self.format,
            "bodies": [{"joint": b.joint, "link": b.link, "attached": list(b.attached), "kept": b.kept} for b in self.bodies],
            "notes": list(self.notes),
        }


def export(
    source: Identified | Estimate,
    target: str | Path,
    *,
    kind: str | None = None,
    urdf: str | Path | None = None,
    attached: Attached | str = Attached.KEEP,
    allow_inconsistent: bool = False,
    force: bool = False,
) -> Exported:
    """Write an identified robot as a file for other programs.

    Parameters
    ----------
    source : Estimate or Identified
        What was identified.
    target : str or Path
        Written completely or not at all.
    kind : str, optional
        Format; by default it follows from the suffix (.urdf, .xml or .mjcf, .json).
    urdf : str or Path, optional
        The file to be patched; by default the one that the robot was loaded from.
    attached : Attached or str
        What becomes of the inertials of links attached through fixed joints.
    allow_inconsistent : bool
        Write parameters that no bodies can have.
    force : bool
        Write over an existing file.

    Returns
    -------
    Exported
        The path, and what was written for each body.

    Raises
    ------
    ConfigurationError
        An unknown format, an existing file, or parameters that no bodies can have.

    Examples
    --------
    >>> import ident, tempfile, pathlib
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> ident.export(estimate, folder / "identified.json").format
    'json'
    """
    target = Path(target)
    kind = kind or {".urdf": "urdf", ".xml": "mjcf", ".mjcf": "mjcf", ".json": "json"}.get(target.suffix.lower())
    if kind not in FORMATS:
        raise unknown_name("export format", str(kind or target.suffix), FORMATS)
    if target.exists() and not force:
        raise ConfigurationError(f"{target} exists; nothing was written. Choose another name, or allow overwriting (--force, force=True).")
    found = source if isinstance(source, Identified) else Identified.of(source)
    notes = found.notes
    bodies: tuple[BodyExport, ...] = ()
    left = found.left_out()
    if kind == "urdf":
        data, where = source_text(found.robot, urdf)
        dynamics, more = _urdf_dynamics(found)
        patched = patch_urdf(data, where, found.robot, found.inertial, attached=attached, allow_inconsistent=allow_inconsistent, **dynamics)
        content: str | bytes = patched.data
        bodies, notes = patched.bodies, notes + patched.notes + more
    elif kind == "mjcf":
        content, more = mjcf_text(found.robot, found.inertial, found.drive())
        notes += more
    else:
        body = {"schema": "ident.parameters/1", "ident_version": __version__, **found.to_dict()}
        content, left = json.dumps(jsonable(body), indent=1, allow_nan=False) + "\n", ()
        unreal = np.flatnonzero(smallest_eigenvalues(found.inertial) <= 0)
        if len(unreal):
            names = ", ".join(str(body["links"][i]["link"]) for i in unreal)
            notes += (f"links {names} are no real bodies: good for torque, not for simulation.",)
    if left:
        notes += (f"not part of a {kind.upper()}: {', '.join(dict.fromkeys(left))}.",)
    write_atomic(target, content, force=force)
    return Exported(str(target), kind, bodies, notes)


def export_urdf(estimate: Identified | Estimate, source: str | Path | None, target: str | Path, **options: Any) -> Exported:
    """Patch the URDF `source` with what was identified and write it to `target`; see `export`."""
    return export(estimate, target, kind="urdf", urdf=source, **options)


def _urdf_dynamics(found: Identified) -> tuple[dict[str, Mapping[str, float]], tuple[str, ...]]:
    """Damping and friction per joint on the joint side, where the transmission does not couple joints, and notes."""
    robot, drive = found.robot, found.drive()
    notes: tuple[str, ...] = ()
    if np.any(drive["armature"] != 0):
        notes = ("rotor inertia has no place in a URDF: it stays with the controller or simulator (see the JSON export).",)
    if not robot.transmission.is_diagonal:
        if not (np.any(drive["damping"] != 0) or np.any(drive["frictionloss"] != 0)):
            return {}, notes
        return {}, (*notes, "friction acts on motors that share joints, which a URDF cannot say: its <dynamics> were left as they are.")
    k = np.abs(np.diagonal(robot.transmission.K))
    has = found.identified()

    def told(key: str, values: Array) -> dict[str, float]:
        # What the model does not have, or the data did not tell, stays as the file has it.
        return {name: float(v) for name, v, here in zip(robot.joint_names, values, has[key], strict=True) if here}

    return {"damping": told("damping", drive["damping"] / k**2), "friction": told("frictionloss", drive["frictionloss"] / k)}, notes
