"""The world the pipeline runs in: robot and scenes in MuJoCo, sensors, external wrenches, backends, benchmarks."""
