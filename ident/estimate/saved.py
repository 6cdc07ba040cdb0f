"""A saved fit read back: every field is of its kind and shape, or is named in the refusal."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .._utils.fields import Field
from .._utils.structured import read_json
from ..effects.base import Effect
from ..effects.registry import effect_types, make_effect
from ..errors import ConfigurationError
from ..model import Model
from ..problem.information import Form, Information
from ..problem.integrated import ENERGY
from ..regressor.base_parameters.reduction import BaseReduction
from ..robots.robot import Robot
from ..robots.transmission import Side, Transmission
from ..statistics.noise import NoiseModel
from ..statistics.torque_error import JudgedOn, TorqueError
from .io import CHECKSUM, SCHEMA, checksum
from .record import EstimateRecord, ReversalsLeftOut
from .status import Status, StatusCode

Array = np.ndarray
_E = TypeVar("_E", bound=EstimateRecord)


def load(kind: type[_E], path: Path) -> _E:
    """Read what `save` wrote, as an estimate of class `kind`."""
    path = Path(path)
    if path.is_dir() and (path / "fit.json").is_file():  # the folder of `ident fit --out`
        path = path / "fit.json"
    data = read_json(path, "fit")
    if isinstance(data, dict) and "drive_state" in data:
        raise ConfigurationError(
            f"fit {path}: is a fit under a drive law, to commands and positions; this needs one to measured torque."
            " `ident validate --fit`, `ident export` and `ident report` take it."
        )
    if not isinstance(data, dict) or data.get("schema") != SCHEMA or "state" not in data:
        raise ConfigurationError(
            f"fit {path}: is not a saved fit ({SCHEMA} with its state). Write one with `ident fit --out DIR` or Estimate.save."
        )
    changed = CHECKSUM in data and data.pop(CHECKSUM) != checksum(data)
    try:
        found = _restored(kind, Field(data, f"fit {path}"))
    except ConfigurationError as error:
        told = str(error)
        raise error if told.startswith("fit ") else ConfigurationError(f"fit {path}: {told}") from None
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise ConfigurationError(
            f"fit {path}: is damaged, or another version of ident wrote it ({type(error).__name__}: {error}). Fit again."
        ) from None
    if not changed:
        return found
    said = f"{path} was changed after ident wrote it: its checksum does not match."
    warnings.warn(said, stacklevel=3)
    return dataclasses.replace(found, warnings=(*found.warnings, said))


def _restored(kind: type[_E], data: Field) -> _E:
    state = data["state"]
    model = model_from_dict(_model_fields(state["model"]))
    k, n, b = len(model.parameters), model.robot.n, len(list(data["parameters"].items()))
    base = state["base"]
    reduction = BaseReduction(
        model.parameters, base["independent"].indices(k, b), base["regroup"].numbers(b, k), base["zero"].indices(k),
        tuple(base["gap"].numbers(2).tolist()), base["notes"].texts(),
    )  # fmt: skip
    _check_regroup(base["regroup"], reduction)
    covariance = data["covariance"].numbers(b, b, absent=True)
    if np.any(np.diag(covariance) < 0):
        raise data["covariance"].fault("a covariance, whose diagonal is not negative")
    heldout = data["torque_error"]["heldout"]
    reference = state["reference"]
    # Rows of a fit: one a joint, or one for the whole robot (energy form).
    rows = 1 if "form" in data["trace"] and data["trace"]["form"].value == ENERGY else n
    return kind(
        method=data["method"].text(),
        model=model,
        base=reduction,
        values=np.array([p["value"].number() for p in data["parameters"].items()]),
        covariance=covariance,
        status=Status(StatusCode(data["status"]["code"].one_of(StatusCode)), state["status_details"].texts()),
        fit_error=_error(data["torque_error"]["fit"], state["rows"]["fit"], n),
        noise=_noise(state["noise"], rows),
        weights=_weights(state["weights"], rows),
        condition=data["condition"].number(absent=True),
        samples=data["samples"].whole(),
        information=_information(state["information"], rows) if "information" in state else None,
        reference=None if reference.value is None else reference.numbers(k),
        dropped=data["not_determined"].texts(),
        reversals_left_out=_reversals(data, model),
        warnings=data["warnings"].texts(),
        heldout_error=_error(heldout, state["rows"]["heldout"], n) if heldout["rms"].value else None,
        inputs=tuple({key: i[key].text() for key in i.table()} for i in data["inputs"].items()),
        signals_config=data["signals"].table(),
        trace=data["trace"].table(),
    )


def _check_regroup(field: Field, base: BaseReduction) -> None:
    """Each base parameter holds its own stayer once, and no other's."""
    if base.count and not np.array_equal(base.regroup[:, base.independent], np.eye(base.count)):
        raise field.fault("a grouping in which every independent parameter stands once, with factor 1")


def _weights(field: Field, n: int) -> Array:
    weights = field.numbers(n)
    if np.any(weights < 0):
        raise field.fault("numbers that are not negative")
    return weights


def _noise(data: Field, n: int) -> NoiseModel:
    return NoiseModel(
        data["ar"].numbers(n, -1, absent=True),
        data["innovation"].numbers(n, n, absent=True),
        data["variance"].numbers(n, absent=True),
        data["correlation_time"].numbers(n, absent=True),
    )


def _information(data: Field, n: int) -> Information:
    names = data["names"].texts()
    k = len(names) + 1
    factors = np.zeros((n, k, k))
    for R, packed in zip(factors, data["triangles"].items(n), strict=True):
        R[np.triu_indices(k)] = packed.numbers(k * (k + 1) // 2)
    counts = np.array([c.whole() for c in data["counts"].items(n)], np.int64)
    form = data["form"].one_of(Form) if "form" in data else Form.TRIANGLE
    return Information(factors, counts, names, Form(form))


def _reversals(data: Field, model: Model) -> tuple[ReversalsLeftOut, ...]:
    """Rows near reversals that were left out; files of version 0.2 name the joints only."""
    if "sticking_joints" in data:
        field = data["sticking_joints"]
        found = tuple(ReversalsLeftOut(name) for name in field.texts())
    else:
        field = data["rows_near_reversals_left_out"]
        found = tuple(ReversalsLeftOut(r["joint"].text(), _known(r["rows"]), _known(r["usable"])) for r in field.items())
    if not {r.joint for r in found} <= set(model.robot.joint_names):
        raise field.fault(f"joints of the robot ({', '.join(model.robot.joint_names)})")
    return found


def _known(field: Field) -> int | None:
    return None if field.value is None else field.whole()


def _error(data: Field, rows: Field, n: int) -> TorqueError:
    return TorqueError(
        data["rms"].numbers(n, absent=True),
        data["relative"].numbers(n, absent=True),
        data["relative_all"].number(absent=True),
        np.array([r.whole() for r in rows.items(n)]),
        JudgedOn(data["judged"].one_of(JudgedOn)) if "judged" in data else JudgedOn.ROWS,
        data["band_hz"].number(absent=True) if "band_hz" in data and data["band_hz"].value is not None else None,
    )


def _model_fields(model: Field) -> dict[str, Any]:
    """The fields that `model_from_dict` reads, each of its kind."""
    robot, drive = model["robot"], model["drive"]
    robot["name"].text()
    robot["urdf_text"].text()
    robot["gravity"].numbers(3)
    for joint in robot["locked"].table():
        robot["locked"][joint].number()
    if robot["joints"].value is not None:
        robot["joints"].texts()
    for joint in robot["loop"].table():
        for term in robot["loop"][joint].table():
            robot["loop"][joint][term].number()
    if not isinstance(robot["floating_base"].value, bool):
        raise robot["floating_base"].fault("true or false")
    n = drive["K"].numbers(-1, -1).shape[0]
    drive["K"].numbers(n, n)
    drive["zero"].numbers(n)
    drive["measured"].one_of(Side)
    if drive["torque_constants"].value is not None:
        drive["torque_constants"].numbers(n)
    for effect in model["effects"].items():
        effect["name"].text()
    return model.table()


def model_from_dict(data: dict[str, Any]) -> Model:
    """The model that `model_to_dict` wrote."""
    robot, drive = data["robot"], data["drive"]
    built = Robot.from_urdf(
        robot["urdf_text"],
        gravity=robot["gravity"],
        locked=robot["locked"],
        joints=robot["joints"],
        loop=robot["loop"],
        floating_base=robot["floating_base"],
        name=robot["name"],
    )
    K = np.array(drive["K"], float)
    constants = drive["torque_constants"]
    built = built.with_transmission(
        Transmission(K, np.array(drive["zero"], float), drive["measured"], None if constants is None else np.array(constants, float))
    )
    known = {key: robot[key] for key in ("urdf", "robot", "payload") if key in robot}
    built = dataclasses.replace(built, source={**built.source, **known})
    effects = tuple(_effect(e) for e in data["effects"])
    return Model(built, effects)


def _effect(data: dict[str, Any]) -> Effect:
    """An effect as it was saved. Raises ConfigurationError for one that is not known here."""
    if data["name"] not in effect_types():
        raise ConfigurationError(
            f"unknown effect {data['name']!r}: if it is one of your own, name its file (--plugin FILE; in Python, import it before)."
        )
    return make_effect(**_tuples(data))


def _tuples(effect: dict[str, Any]) -> dict[str, Any]:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in effect.items()}
