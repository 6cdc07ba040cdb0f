"""Export of an identified robot: URDF patched in place, MJCF, JSON."""

from __future__ import annotations

from .export import Exported, Identified, export, export_urdf

__all__ = ["Exported", "Identified", "export", "export_urdf"]
