"""The audit: what in the logs would harm an estimate, what it means, and what to do about it."""

from __future__ import annotations

from .audit import audit
from .findings import Audit, AuditFinding, Severity

__all__ = ["Audit", "AuditFinding", "Severity", "audit"]
