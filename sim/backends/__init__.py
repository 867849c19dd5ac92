"""Backends: the simulator and, later, the robot, behind one protocol (sim.backends.protocol)."""
