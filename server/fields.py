"""Request fields: strict numbers and vectors whose errors name the allowed range.

The classes are pydantic annotations: `speed: Annotated[float, Number((0.1, 4.0))]`.
"""

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

Range = tuple[float, float]


class RequestModel(BaseModel):
    """A request body: no unknown fields, no coercion, and null is not a value."""

    model_config = ConfigDict(extra="forbid", strict=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_null(cls, data: Any) -> Any:
        for name in [name for name, value in data.items() if value is None] if isinstance(data, dict) else ():
            raise PydanticCustomError("null", "must not be null", {"field": str(name), "allowed": "leave it out instead"})
        return data


def in_words(limits: Range, unit: str = "") -> str:
    """A range for people, such as "-40 to 40 N"."""
    return f"{limits[0]:g} to {limits[1]:g} {unit}".strip()


def _refuse(problem: str, allowed: str, index: int | None = None) -> PydanticCustomError:
    context: dict[str, Any] = {"allowed": allowed}
    if index is not None:
        context["index"] = index
    return PydanticCustomError("refused", problem, context)  # pyright: ignore[reportArgumentType]


def _checked(value: Any, limits: Range, allowed: str, index: int | None = None) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _refuse("must be a number", allowed, index)
    if not limits[0] <= value <= limits[1]:  # NaN is in no range
        raise _refuse("is outside the allowed range", allowed, index)
    return float(value)


@dataclass(frozen=True, slots=True)
class Number:
    """One finite number within `limits`; for `int` fields a whole one."""

    limits: Range
    unit: str = ""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        allowed = in_words(self.limits, self.unit)

        def check(value: Any) -> float | int:
            number = _checked(value, self.limits, allowed)
            if source is not int:
                return number
            if number != int(number):
                raise _refuse("must be a whole number", allowed)
            return int(number)

        return core_schema.no_info_before_validator_function(check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        lower, upper = self.limits
        return {**handler(schema), "minimum": lower, "maximum": upper, "description": in_words(self.limits, self.unit)}


@dataclass(frozen=True, slots=True)
class Vector:
    """A list with one finite number per range of `limits`."""

    limits: tuple[Range, ...]
    unit: str = ""

    def in_words(self) -> str:
        """All ranges, once if they are the same."""
        if len(set(self.limits)) == 1:
            return f"{len(self.limits)} numbers, each {in_words(self.limits[0], self.unit)}"
        return f"{len(self.limits)} numbers: {', '.join(in_words(limits) for limits in self.limits)} {self.unit}".strip()

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        def check(value: Any) -> list[float]:
            if not isinstance(value, list) or len(value) != len(self.limits):
                raise _refuse(f"must be a list of {len(self.limits)} numbers", self.in_words())
            return [_checked(item, self.limits[i], in_words(self.limits[i], self.unit), i) for i, item in enumerate(value)]

        return core_schema.no_info_before_validator_function(check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        size = len(self.limits)
        return {**handler(schema), "minItems": size, "maxItems": size, "description": self.in_words()}


@dataclass(frozen=True, slots=True)
class Mask:
    """A list of three entries, 0 (position) or 1 (force), for x, y, z."""

    ALLOWED = "3 entries, each 0 (position) or 1 (force)"

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        def check(value: Any) -> list[int]:
            if not isinstance(value, list) or len(value) != 3:
                raise _refuse("must be a list of 3 entries", self.ALLOWED)
            for index, item in enumerate(value):
                if isinstance(item, bool) or not isinstance(item, int | float) or item not in (0, 1):
                    raise _refuse("must be 0 or 1", self.ALLOWED, index)
            return [int(item) for item in value]

        return core_schema.no_info_before_validator_function(check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        items = {"type": "integer", "enum": [0, 1]}
        return {**handler(schema), "items": items, "minItems": 3, "maxItems": 3, "description": self.ALLOWED}
