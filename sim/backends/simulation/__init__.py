"""The MuJoCo backend: physics, sensors, external wrenches, mass mismatch and ground truth."""
