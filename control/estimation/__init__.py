"""From sensors to base state and hand force."""
