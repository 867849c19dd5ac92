"""What route handlers are given.

By coroutines: FastAPI runs plain functions in a thread, whose turns an e-stop would wait for.
"""

from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from server.build_info import BuildInfo
from server.operator import Operator


async def _operator(connection: HTTPConnection) -> Operator:
    return connection.app.state.operator


async def _build(connection: HTTPConnection) -> BuildInfo:
    return connection.app.state.build


TheOperator = Annotated[Operator, Depends(_operator)]
TheBuild = Annotated[BuildInfo, Depends(_build)]
