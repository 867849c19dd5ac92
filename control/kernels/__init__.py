"""What the compiled laws are written with: the decorator, records of named numbers, algebra of small arrays."""
