"""Training of networks on recorded rollouts: PyTorch, no simulator."""
