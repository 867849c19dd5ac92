"""Schema of the operator's command."""

from server.answers.schema import Answer, Mask, Quaternion, Vector3


class CommandFields(Answer):
    """What hand and base are to do."""

    mask: Mask
    """for x, y, z of heading: 0 position, 1 force"""
    force_n: Vector3
    """N, heading, of the environment on the hand: pressing down is +z; counts where the mask is 1"""
    position_m: Vector3
    """m, heading, of the hand; counts where the mask is 0"""
    orientation_wxyz: Quaternion
    """of the hand in heading"""
    base_velocity: Vector3
    """m/s forward, m/s to the left, rad/s of yaw to the left"""
    guidance: bool
    """zero-force guidance: the robot follows the hand"""


class CommandAnswer(CommandFields):
    """The command as asked, within limits."""

    sequence: int
    """counts the commands asked for; the command acts once `command_sequence` of the state has reached it"""
