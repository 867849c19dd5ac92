"""The Unitree Z1 arm over UDP: frames, gain units, and the driver that talks to the vendor's `z1_ctrl` process.

Protocol-verified, not robot-verified.
"""
