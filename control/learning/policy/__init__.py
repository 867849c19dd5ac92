"""Training of the policy: imitation and multi-critic PPO."""
