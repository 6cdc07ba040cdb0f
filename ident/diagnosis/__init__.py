"""What a declared model lacks: the search over the catalogue, the verdict, and the model that has it."""

from .diagnosis import Diagnosis, diagnose
from .next_motion import NextMotion, next_motion
from .result import Finding, FoundParameter, Hidden, Imitator, Unexplained
from .verdict import Verdict

__all__ = [
    "Diagnosis", "Finding", "FoundParameter", "Hidden", "Imitator", "NextMotion", "Unexplained", "Verdict", "diagnose", "next_motion",
]  # fmt: skip
