"""A saved fit of either kind: to measured torque, or under a drive law."""

from __future__ import annotations

from pathlib import Path

from .._utils.structured import read_json
from ..drives import DriveFit
from ..drives.result import is_drive_fit
from ..estimate.estimate import Estimate


def saved_fit(path: str) -> Estimate | DriveFit:
    """Read a saved fit, or that of a folder that `ident fit --out` filled. Raises ConfigurationError."""
    file = Path(path)
    if file.is_dir() and (file / "fit.json").is_file():
        file = file / "fit.json"
    return DriveFit.load(file) if is_drive_fit(read_json(file, "fit")) else Estimate.load(file)
