"""The base's wire protocol: DDS messages, their codec and CRC, remote procedure calls, and the driver on top.

Protocol-verified, not robot-verified: bytes, checksums and type identifiers equal the vendor's published ones, and the
vendor's own software talks to sim.emulator; none of it has driven a robot.
"""
