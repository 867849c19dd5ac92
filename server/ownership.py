"""Forcelens' packages have plain names, and python-control also calls itself `control`: refuse to run on someone else's."""

from collections.abc import Callable, Iterable
from importlib.machinery import ModuleSpec
from pathlib import Path


class ShadowedPackageError(ImportError):
    """Another distribution's package hides one of ours; the message says which file and the cure."""


def check_ownership(names: Iterable[str], root: Path, find_spec: Callable[[str], ModuleSpec | None]) -> None:
    """Make sure that importing each name would load it from `root`.

    Args:
        names: top-level package names that belong to Forcelens.
        root: folder that holds them.
        find_spec: `importlib.util.find_spec`.

    Raises:
        ShadowedPackageError: a name is found elsewhere, or not at all.
    """
    for name in names:
        ours = root / name / "__init__.py"
        spec = find_spec(name)
        found = spec.origin if spec is not None else None
        if found is None or Path(found).resolve() != ours:
            raise ShadowedPackageError(
                f"import {name!r} finds {found or 'nothing'} instead of Forcelens' own {ours}. Install Forcelens in an "
                f"environment of its own (python -m venv .venv && .venv/bin/pip install -e .), without python-control or "
                f"anything else that provides {name!r}."
            )
