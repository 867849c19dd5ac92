"""Networks that correct the model-based force estimate."""
