"""Recordings: from the control process through shared memory and a process of their own into MCAP files, and back."""
