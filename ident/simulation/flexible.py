"""Joints whose drive is not rigidly tied to the link: elasticity and backlash as a spring between two moving masses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class FlexibleJoints:
    """Springs between drive and link of the named joints, on the joint side (Spong, 1987).

    For each joint: `stiffness` N m/rad (N/m), `damping` N m s/rad and the free play `gap` (rad or m, both ways together). The
    drive side of each such joint is a coordinate of its own; it needs rotor inertia in the model. Subclass and override
    `torque` for another law."""

    joints: tuple[str, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    gap: tuple[float, ...] = ()

    def torque(self, deflection: Array, rate: Array) -> Array:
        """Torque (B, f) of the springs on the links at drive minus link position and velocity (B, f)."""
        half = np.asarray(self.gap) / 2.0 if self.gap else np.zeros(len(self.joints))
        pressed = np.sign(deflection) * np.maximum(np.abs(deflection) - half, 0.0)
        # Damping grows in over the first tenth of the gap, so that contact begins without a jump (Hunt & Crossley, 1975).
        contact = np.where(half > 0, np.minimum(np.abs(pressed) / np.where(half > 0, 0.2 * half, 1.0), 1.0), 1.0)
        return np.asarray(self.stiffness) * pressed + np.asarray(self.damping) * rate * contact

    def rest(self, torque: Array) -> Array:
        """Deflection (B, f) at which the springs carry a torque (B, f) at rest."""
        half = np.asarray(self.gap) / 2.0 if self.gap else np.zeros(len(self.joints))
        return torque / np.asarray(self.stiffness) + np.sign(torque) * half
