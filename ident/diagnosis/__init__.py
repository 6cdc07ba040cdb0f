"""What a declared model lacks: the search over the catalogue, the verdict, and the model that has it."""

from .diagnosis import Diagnosis, diagnose
from .result import Finding, FoundParameter, Hidden, Imitator, Unexplained
from .verdict import Verdict

__all__ = ["Diagnosis", "Finding", "FoundParameter", "Hidden", "Imitator", "Unexplained", "Verdict", "diagnose"]
