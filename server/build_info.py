"""Which Forcelens this is."""

import tomllib
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from control.paths import ROOT
from control.provenance import commit


@dataclass(frozen=True, slots=True)
class BuildInfo:
    """Version of the package, and git commit of a checkout ("unknown" outside one)."""

    version: str
    commit: str


def build_info() -> BuildInfo:
    """Read it."""
    try:
        return BuildInfo(version("forcelens"), commit())
    except PackageNotFoundError:  # run from a checkout that is not installed
        project = ROOT / "pyproject.toml"
        return BuildInfo(tomllib.loads(project.read_text())["project"]["version"], commit())
