"""An attribute that is computed when it is first read.

As `functools.cached_property`, without its lock, which in Python 3.11 all instances of a class share: it costs time in
every step, and makes threads wait for each other. Two threads that read the same attribute of one object for the first
time may both compute it, to the same result.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

Value = TypeVar("Value")


class lazy(Generic[Value]):
    """Decorator of a method without arguments; the object needs a `__dict__`, and may be frozen."""

    def __init__(self, compute: Callable[[Any], Value]) -> None:
        self._compute, self.__doc__ = compute, compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...
    def __get__(self, instance: object | None, owner: type) -> Self | Value:
        if instance is None:
            return self
        # From now on Python finds the value here before it finds this descriptor.
        value = instance.__dict__[self._name] = self._compute(instance)
        return value
