"""The learned force controllers that the paper compares with, on this robot: Portela et al. 2024, Zhi et al. 2025 (UniFP)."""
