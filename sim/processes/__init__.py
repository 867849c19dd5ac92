"""Shared memory, real-time scheduling and process pools."""
