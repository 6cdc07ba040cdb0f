"""The audit: what in the logs would harm an estimate, what it means, and what to do about it."""

from __future__ import annotations

from .audit import Audit, Finding, Severity, audit

__all__ = ["Audit", "Finding", "Severity", "audit"]
