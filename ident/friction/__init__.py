"""The drive side of the effect contract: rotor inertia and friction."""

from .drive import Coulomb, RotorInertia, Viscous

__all__ = ["Coulomb", "RotorInertia", "Viscous"]
