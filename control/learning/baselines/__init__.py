"""Training of the baselines' networks: the policy's imitation and PPO, and an estimation head beside them."""
