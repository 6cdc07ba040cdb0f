"""Forward simulation: rigid body, forces with dry friction, integration with events, sensors and actuators."""
