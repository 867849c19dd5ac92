"""The edge: the command line, the web application and the real-time process that it supervises."""

import importlib.util
from pathlib import Path

from server.ownership import check_ownership

check_ownership(("control", "sim", "web"), Path(__file__).resolve().parents[1], importlib.util.find_spec)
