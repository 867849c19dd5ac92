"""Training of networks on recorded rollouts: PyTorch, no simulator."""

import importlib.util

if importlib.util.find_spec("torch") is None:
    raise ModuleNotFoundError("training needs PyTorch, which the console does not: pip install -e '.[train]'", name="torch")
