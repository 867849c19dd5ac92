"""Rollouts and trials that data collection, training scores and benchmarks share."""
