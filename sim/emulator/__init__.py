"""An emulated robot: the base's DDS topics and calls and the arm's UDP frames on the wire, MuJoCo behind them.

What it stands for: message layout, checksums, order of motors, calls, timing. What it does not: firmware reactions to lost
or doubled commands, motor friction, saturation and heat, battery scale. Those need the robot.
"""
