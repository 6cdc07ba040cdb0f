"""Signals and the strategies that prepare them: the public names of this stage of the pipeline.

prep = ident.ZeroPhase(cutoff_hz=10)
signals = prep(logs)              # or prep(logs, robot)
print(signals.report)
"""

from __future__ import annotations

from .cutoff import CutoffChoice, choose_cutoff
from .filters import RowFilter, central_differences, zero_phase_lowpass
from .masks import NearReversals, Standstill
from .preparation import CentralDifference, Preparation, Recorded, SavitzkyGolay, Velocity, ZeroPhase, make_preparation, preparation_names
from .signals import Block, JointReport, PreparationReport, Signals

__all__ = [
    "Block",
    "CentralDifference",
    "CutoffChoice",
    "JointReport",
    "NearReversals",
    "Preparation",
    "PreparationReport",
    "Recorded",
    "RowFilter",
    "SavitzkyGolay",
    "Signals",
    "Standstill",
    "Velocity",
    "ZeroPhase",
    "central_differences",
    "choose_cutoff",
    "make_preparation",
    "preparation_names",
    "zero_phase_lowpass",
]
