"""Actuators of real robots whose logs hold commands and positions, and no torque."""
