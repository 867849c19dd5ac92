"""What stands between the control process and the motors of a real robot: its own process, its own states and limits.

Protocol-verified, not robot-verified: everything here has run against sim.emulator and the vendor's software, never a robot.
"""
