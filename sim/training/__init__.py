"""The batched training world of the policy."""
