"""What the hands do by themselves: tasks on estimates alone, by name. CONTRIBUTING tells how to add one."""

from collections.abc import Mapping

from sim.tasks.box import Box
from sim.tasks.door import Door
from sim.tasks.guidance import GuidanceTask
from sim.tasks.sequence import Sequence
from sim.tasks.task import SITE_OPTIONS, Option, Task
from sim.tasks.valve import Valve
from sim.tasks.wipe import Wipe

TASKS: Mapping[str, type[Task]] = {task.NAME: task for task in (Wipe, Valve, Door, Box, GuidanceTask, Sequence)}


def options_of(name: str) -> dict[str, Option]:
    """What shapes the task of this name.

    Raises:
        ValueError: no task has this name (the message lists them).
    """
    if name not in TASKS:
        raise ValueError(f"no task {name!r}; the tasks are {', '.join(TASKS)}")
    return {**TASKS[name].OPTIONS, **SITE_OPTIONS}


def chosen_options(name: str, options: Mapping[str, float]) -> dict[str, float]:
    """All options of a task, those that are not given at their defaults.

    Raises:
        ValueError: no such task or option, or a value out of its range (the message says which).
    """
    known = options_of(name)
    for key, value in options.items():
        if key not in known:
            raise ValueError(f"task {name!r} has no option {key!r}; it has {', '.join(known)}")
        option = known[key]
        if not option.minimum <= value <= option.maximum:
            allowed = f"{option.minimum:g} to {option.maximum:g} {option.unit}".strip()
            raise ValueError(f"option {key} is {value}; the range is {allowed}")
    return {key: float(options.get(key, option.default)) for key, option in known.items()}
