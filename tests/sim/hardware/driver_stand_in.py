"""Stands in for the I/O process in test_vendor_peer.py: connects to a robot again and again, then stays until it is killed.

Arguments: DDS domain, number of connections, and optionally a file that takes the place of sim/backends/unitree/idl.py.
Every connection lasts until a state has come and a command has gone; its number is written when it is closed.
"""

import sys
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np

from sim.backends.unitree.dds import DdsBaseLink, DdsConfig
from sim.backends.unitree.driver import BaseDriver

IDL = "sim.backends.unitree.idl"


def replace_types(path: str) -> None:
    spec = spec_from_file_location(IDL, path)
    assert spec is not None and spec.loader is not None
    sys.modules[IDL] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[IDL])


def connect(domain: int) -> BaseDriver:
    driver = BaseDriver(DdsBaseLink(DdsConfig(domain)))
    while not driver.poll(0.0):
        driver.link.wait(0.1)
    driver.write(np.zeros((5, 16)))
    return driver


def main(domain: int, connections: int, *types: str) -> None:
    for path in types:
        replace_types(path)
    for number in range(connections):
        connect(domain).close()
        sys.stdout.write(f"{number + 1}\n")
        sys.stdout.flush()
    driver = connect(domain)
    sys.stdout.write("staying\n")
    sys.stdout.flush()
    while True:
        driver.link.wait(1.0)
        driver.poll(0.0)


main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
