"""Types of command-line arguments."""

import argparse
from collections.abc import Callable, Mapping, Sequence


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


def from_environment(
    parser: argparse.ArgumentParser, prefix: str, environment: Mapping[str, str], skip: Sequence[str] = ()
) -> None:
    """Let every option default to its variable: of `--arm-host` PREFIX_ARM_HOST, which an empty value leaves unset.

    Args:
        parser: whose options have been added.
        prefix: of the variables.
        environment: where they are looked up.
        skip: options that are not meant, by the name of their value.
    """
    for action in parser._actions:
        if not action.option_strings or action.dest in ("help", *skip):
            continue
        variable = f"{prefix}_{action.dest.upper()}"
        action.help = f"{action.help} [{variable}]"
        value = environment.get(variable)
        if not value:
            continue
        if action.nargs == 0:
            if value.lower() not in _YES | _NO:
                parser.error(f"{variable}={value!r} is neither of 1 and 0")
            action.default = value.lower() in _YES
        elif action.choices is not None and value not in action.choices:
            parser.error(f"{variable}={value!r} is none of {', '.join(map(str, action.choices))}")
        else:
            action.default = value  # argparse converts what is text


_YES, _NO = frozenset({"1", "true", "yes", "on"}), frozenset({"0", "false", "no", "off"})
