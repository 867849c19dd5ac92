"""What would run on the robot: estimation, control and safety. Imports no simulator, viewer or web framework."""
