"""Benchmarks: `python -m sim.benchmarks.NAME --help`. Each writes rows and bars in one format (sim.benchmarks.report)."""
