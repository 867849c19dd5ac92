"""The baselines in the batched training world: their observations, estimation targets and rewards."""
