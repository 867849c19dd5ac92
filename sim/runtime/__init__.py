"""A session: one backend and one pipeline, tick by tick, and the snapshot that it publishes."""
