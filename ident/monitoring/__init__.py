"""Monitoring: what has changed since a fit was made, estimated from new logs."""

from .result import Change, ChangedParameter, Drift, How, Monitoring
from .watch import monitor

__all__ = ["Change", "ChangedParameter", "Drift", "How", "Monitoring", "monitor"]
