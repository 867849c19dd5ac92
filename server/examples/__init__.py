"""Programs around `server.client`; each drives a running console and draws what came of it."""
