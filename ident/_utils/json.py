"""What every JSON result carries: schema, version, inputs, time of making, warnings (docs/formats.md)."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from .version import __version__


def result(
    schema: str, body: Mapping[str, Any], *, inputs: Iterable[Mapping[str, Any]] = (), warnings: Iterable[str] = ()
) -> dict[str, Any]:
    """A result with its common fields. `inputs`: {"path", "sha256"} each, paths as given."""
    return {
        "schema": schema,
        "ident_version": __version__,
        "created": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
        "inputs": [dict(i) for i in inputs],
        "warnings": list(warnings),
        **jsonable(dict(body)),
    }


def jsonable(value: Any) -> Any:
    """Plain JSON values: arrays become lists, numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [jsonable(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value
