"""What the hand carries and reads without contact."""
