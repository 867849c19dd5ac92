"""What objects carry from tick to tick: taken, put back, and written to files."""
