"""JSON: every parameter by name, links, drive, transmission (`ident.parameters/1`)."""

from __future__ import annotations

import json

import numpy as np

from ..._utils.json import jsonable
from ..._utils.version import __version__
from ...physical.pseudo_inertia import smallest_eigenvalues
from ..identified import Identified
from ..target import ExportOptions, ExportTarget, WrittenFile, register_target


@register_target
class ParametersTarget(ExportTarget):
    """Programs of the user's own."""

    name = "json"
    title = "JSON: every parameter by name"
    suffixes = (".json",)

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        body = {"schema": "ident.parameters/1", "ident_version": __version__, **found.to_dict()}
        notes = found.notes
        unreal = np.flatnonzero(smallest_eigenvalues(found.inertial) <= 0)
        if len(unreal):
            names = ", ".join(str(body["links"][i]["link"]) for i in unreal)
            notes += (f"links {names} are physically inconsistent: use them for torque, not for simulation.",)
        return WrittenFile(json.dumps(jsonable(body), indent=1, allow_nan=False) + "\n", notes)
