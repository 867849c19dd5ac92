"""What the operator asks: limits, filter, guidance and the tip-over limit."""
