"""Maps a function over many arguments on local processes or on a Ray cluster; results come as they get ready."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, TypeVar

Argument = TypeVar("Argument")
Result = TypeVar("Result")

EXECUTOR_NAMES = ("local", "ray")


class ExecutorError(RuntimeError):
    """An executor is not available; the message names the cure."""


def map_unordered(
    executor: str,
    function: Callable[[Argument], Result],
    arguments: Sequence[Argument],
    workers: int,
    address: str | None = None,
) -> Iterator[Result]:
    """Results of `function` on all `arguments`, in the order in which they finish.

    Args:
        executor: of EXECUTOR_NAMES.
        function: importable by its module and name; runs in other processes.
        arguments: picklable.
        workers: processes at a time.
        address: of a running Ray cluster; None starts a local one.

    Raises:
        ExecutorError: Ray is wanted but not installed.
        ValueError: unknown executor.
    """
    if executor == "local":
        return _local(function, arguments, workers)
    if executor == "ray":
        return _ray(function, arguments, workers, address)
    raise ValueError(f"unknown executor {executor!r}; available: {', '.join(EXECUTOR_NAMES)}")


def _local(function: Callable[[Argument], Result], arguments: Sequence[Argument], workers: int) -> Iterator[Result]:
    # Spawned processes: forked ones would share the state of MuJoCo and BLAS. They may have processes of their own.
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            for future in as_completed([pool.submit(function, argument) for argument in arguments]):
                yield future.result()
        finally:
            # After an error, or when nobody wants more results, what has not begun does not begin.
            pool.shutdown(wait=False, cancel_futures=True)


def _ray(
    function: Callable[[Argument], Result], arguments: Sequence[Argument], workers: int, address: str | None
) -> Iterator[Result]:
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ExecutorError('the ray executor needs Ray; install it with `pip install -e ".[cluster]"`') from error
    started = not ray.is_initialized()
    if started:
        ray.init(address=address, num_cpus=None if address else workers, include_dashboard=False, log_to_driver=False)
    try:
        task = ray.remote(function)
        waiting = list(arguments)
        running: list[Any] = []
        while waiting or running:
            while waiting and len(running) < workers:
                running.append(task.remote(waiting.pop(0)))
            finished, running = ray.wait(running)
            yield from ray.get(finished)
    finally:
        if started:
            ray.shutdown()
