"""Estimates as JSON: the `ident.fit/1` result, and the saved fit from which everything can be taken up again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .._utils.files import write_atomic
from .._utils.json import jsonable, result
from ..effects.base import Effect
from ..model import Model
from ..statistics.torque_error import number
from .record import EstimateRecord
from .significance import insignificant

Array = np.ndarray
SCHEMA = "ident.fit/1"
#: Field that tells whether the others are as they were written.
CHECKSUM = "checksum"
_E = TypeVar("_E", bound=EstimateRecord)


def to_dict(estimate: EstimateRecord) -> dict[str, Any]:
    """The result as `ident fit --json` prints it."""
    doubtful = {i.name for i in insignificant(estimate)}
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
                "significant": p.name not in doubtful,
            }
            for p, v, s, e in zip(estimate.parameters, estimate.values, estimate.std, estimate.base.expressions, strict=True)
        ],
        "covariance": estimate.covariance,
        "rank": len(estimate.values),
        "condition": number(estimate.condition),
        "samples": estimate.samples,
        "not_determined": list(estimate.dropped),
        "rows_near_reversals_left_out": [dataclasses.asdict(r) for r in estimate.reversals_left_out],
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
    body = {**to_dict(estimate), "state": jsonable(state)}
    return write_atomic(path, json.dumps({**body, CHECKSUM: checksum(body)}), force=force)


def checksum(body: dict[str, Any]) -> str:
    """SHA-256 of a result's fields, whatever their order and the spaces between them."""
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


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
