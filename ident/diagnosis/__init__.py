"""What a declared model lacks: the search over the catalogue, the verdict, and the model that has it."""

from .diagnosis import Diagnosis, diagnose
from .findings import Finding, Imitator, Unexplained
from .precision import FoundParameter

__all__ = ["Diagnosis", "Finding", "FoundParameter", "Imitator", "Unexplained", "diagnose"]
