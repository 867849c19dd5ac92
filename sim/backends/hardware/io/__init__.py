"""The I/O process: owns the wire, outlives the console and damps the robot when it falls silent."""
