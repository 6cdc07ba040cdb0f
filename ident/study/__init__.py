"""Studies: what to identify, from which logs and how; and the session that carries one out."""

from __future__ import annotations

from .fit import fit
from .session import Session
from .study import Study, read_study, write_study

__all__ = ["Session", "Study", "fit", "read_study", "write_study"]
