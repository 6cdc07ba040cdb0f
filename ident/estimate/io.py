"""Estimates as JSON: the `ident.fit/1` result, and the saved fit from which everything can be taken up again."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .._utils.files import write_atomic
from .._utils.json import jsonable, result
from .._utils.structured import read_json
from ..effects.base import Effect, make_effect
from ..errors import ConfigurationError
from ..model import Model
from ..problem.information import Form, Information
from ..regressor.base_parameters.reduction import BaseReduction
from ..robots.robot import Robot
from ..robots.transmission import Transmission
from ..statistics.noise import NoiseModel
from ..statistics.torque_error import TorqueError, number
from .record import EstimateRecord
from .status import Status, StatusCode

Array = np.ndarray
SCHEMA = "ident.fit/1"
_E = TypeVar("_E", bound=EstimateRecord)


def to_dict(estimate: EstimateRecord) -> dict[str, Any]:
    """The result as `ident fit --json` prints it."""
    nothing: dict[str, Any] = {"rms": [], "relative": [], "relative_all": None}
    body = {
        "method": estimate.method,
        "status": estimate.status.to_dict(),
        "parameters": [
            {
                "name": p.name,
                "value": float(v),
                "std": float(s),
                "unit": p.unit,
                "expression": e,
                "effect": p.effect,
                "joint": p.joint,
            }
            for p, v, s, e in zip(estimate.parameters, estimate.values, estimate.std, estimate.base.expressions, strict=True)
        ],
        "covariance": estimate.covariance,
        "rank": len(estimate.values),
        "condition": number(estimate.condition),
        "samples": estimate.samples,
        "not_determined": list(estimate.dropped),
        "sticking_joints": list(estimate.sticking),
        "torque_error": {
            "fit": estimate.fit_error.to_dict(),
            "heldout": estimate.heldout_error.to_dict() if estimate.heldout_error else nothing,
        },
        "signals": estimate.signals_config,
        "trace": estimate.trace,
    }
    return result(SCHEMA, body, inputs=estimate.inputs, warnings=estimate.warnings)


def save(estimate: EstimateRecord, path: Path, *, force: bool) -> Path:
    """Write result and state as one JSON file, atomically."""
    state = {
        "model": model_to_dict(estimate.model),
        "base": {
            "independent": estimate.base.independent,
            "regroup": estimate.base.regroup,
            "zero": estimate.base.zero,
            "gap": estimate.base.gap,
            "notes": estimate.base.notes,
        },
        "noise": dataclasses.asdict(estimate.noise),
        "weights": estimate.weights,
        "reference": estimate.reference,
        "rows": {"fit": estimate.fit_error.rows, "heldout": estimate.heldout_error.rows if estimate.heldout_error else None},
        "status_details": estimate.status.details,
    }
    if estimate.information is not None:
        k = estimate.information.k + 1
        triangle = np.triu_indices(k)
        state["information"] = {
            "names": estimate.information.names,
            "counts": estimate.information.counts,
            "triangles": [R[triangle] for R in estimate.information.factors],
            "form": estimate.information.form.value,
        }
    return write_atomic(path, json.dumps({**to_dict(estimate), "state": jsonable(state)}), force=force)


def load(kind: type[_E], path: Path) -> _E:
    """Read what `save` wrote, as an estimate of class `kind`."""
    data = read_json(Path(path), "fit")
    if not isinstance(data, dict) or data.get("schema") != SCHEMA or "state" not in data:
        raise ConfigurationError(
            f"fit {path}: is not a saved fit ({SCHEMA} with its state). Write one with `ident fit --out DIR` or Estimate.save."
        )
    try:
        return _restored(kind, data)
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise ConfigurationError(
            f"fit {path}: is damaged, or another version of ident wrote it ({type(error).__name__}: {error}). Fit again."
        ) from None


def _restored(kind: type[_E], data: dict[str, Any]) -> _E:
    state = data["state"]
    model = model_from_dict(state["model"])
    base = state["base"]
    reduction = BaseReduction(
        model.parameters, np.array(base["independent"], int), np.array(base["regroup"], float).reshape(-1, len(model.parameters)),
        np.array(base["zero"], int), tuple(base["gap"]), tuple(base["notes"]),
    )  # fmt: skip
    information = None
    if "information" in state:
        names = tuple(state["information"]["names"])
        k = len(names) + 1
        factors = np.zeros((model.robot.n, k, k))
        for R, packed in zip(factors, state["information"]["triangles"], strict=True):
            R[np.triu_indices(k)] = packed
        form = Form(state["information"].get("form", "triangle"))
        information = Information(factors, np.array(state["information"]["counts"], np.int64), names, form)
    noise = {key: np.array(value, float) for key, value in state["noise"].items()}
    heldout = data["torque_error"]["heldout"]
    return kind(
        method=data["method"],
        model=model,
        base=reduction,
        values=np.array([p["value"] for p in data["parameters"]], float),
        covariance=np.array(data["covariance"], float).reshape(len(data["parameters"]), -1),
        status=Status(StatusCode(data["status"]["code"]), tuple(state["status_details"])),
        fit_error=_error(data["torque_error"]["fit"], state["rows"]["fit"]),
        noise=NoiseModel(**noise),
        weights=np.array(state["weights"], float),
        condition=_float(data["condition"]),
        samples=int(data["samples"]),
        information=information,
        reference=None if state["reference"] is None else np.array(state["reference"], float),
        dropped=tuple(data["not_determined"]),
        sticking=tuple(data["sticking_joints"]),
        warnings=tuple(data["warnings"]),
        heldout_error=_error(heldout, state["rows"]["heldout"]) if heldout["rms"] else None,
        inputs=tuple(data["inputs"]),
        signals_config=data["signals"],
        trace=data["trace"],
    )


def _float(x: float | None) -> float:
    return float("nan") if x is None else float(x)


def _error(data: dict[str, Any], rows: list[int]) -> TorqueError:
    return TorqueError(
        np.array([_float(x) for x in data["rms"]]),
        np.array([_float(x) for x in data["relative"]]),
        _float(data["relative_all"]),
        np.array(rows),
    )


def model_to_dict(model: Model) -> dict[str, Any]:
    """A model as data: robot, drive and effects."""
    drive = model.robot.transmission
    return jsonable(
        {
            "robot": {"name": model.robot.name, **model.robot.source},
            "drive": {
                "K": drive.K,
                "zero": drive.zero,
                "measured": drive.measured.value,
                "torque_constants": drive.torque_constants,
            },
            "effects": [effect_to_dict(e) for e in model.effects],
        }
    )


def effect_to_dict(effect: Effect) -> dict[str, Any]:
    """An effect as study files write it: its name and every field that is not at its default."""
    out: dict[str, Any] = {"name": effect.name}
    for f in dataclasses.fields(effect):
        value = getattr(effect, f.name)
        if value != f.default:
            out[f.name] = list(value) if isinstance(value, tuple) else value
    return out


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
    effects = tuple(make_effect(**_tuples(e)) for e in data["effects"])
    return Model(built, effects)


def _tuples(effect: dict[str, Any]) -> dict[str, Any]:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in effect.items()}
