"""Types of command-line arguments."""

import argparse
from collections.abc import Callable


def whole_number(lower: int, upper: int) -> Callable[[str], int]:
    """A type for argparse: a whole number from `lower` to `upper`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or not lower <= value <= upper:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number from {lower} to {upper}")
        return value

    return parse


TCP_PORT = whole_number(0, 65535)
"""To listen on; 0 takes a free one."""

ARM_PORT = whole_number(1, 65534)
"""Of z1_ctrl, which answers on the next."""

DDS_DOMAIN = whole_number(0, 230)
