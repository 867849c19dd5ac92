"""Fixtures around the lockstep rig, and a network for those who need one."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from control.joints import DAMPING, NOMINAL_POSITION, STIFFNESS
from control.types import JointCommand
from tests.dds_domain import dds_domain
from tests.sim.hardware.hardware_rig import Rig


@pytest.fixture
def domain() -> Iterator[int]:
    """DDS domain of this test alone."""
    with dds_domain() as domain:
        yield domain


@pytest.fixture
def make_rig() -> Iterator[Callable[..., Rig]]:
    rigs = []

    def make(**options: object) -> Rig:
        rigs.append(Rig(**options))  # type: ignore[arg-type]
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


@pytest.fixture
def rig(make_rig: Callable[..., Rig]) -> Rig:
    return make_rig()


@pytest.fixture
def ready(rig: Rig) -> Rig:
    rig.start_standing()
    return rig


@pytest.fixture
def hold_command() -> JointCommand:
    zero = np.zeros(22)
    return JointCommand(NOMINAL_POSITION.copy(), zero.copy(), STIFFNESS.copy(), DAMPING.copy(), zero.copy())
