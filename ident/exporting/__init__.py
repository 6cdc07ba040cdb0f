"""Export of an identified robot to simulators and other programs: one target each."""

from __future__ import annotations

from .export import Exported, export, export_urdf
from .identified import Identified
from .target import ExportOptions, ExportTarget, Expressed, WrittenFile, register_target

__all__ = [
    "ExportOptions",
    "ExportTarget",
    "Exported",
    "Expressed",
    "Identified",
    "WrittenFile",
    "export",
    "export_urdf",
    "register_target",
]
