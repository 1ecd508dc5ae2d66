"""Pickling of environments: they are built again from their constructor arguments."""

from typing import Any, Self


def _rebuild(kind: type, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    return kind(*args, **kwargs)


class RebuiltFromArguments:
    """Pickles and copies an object by its constructor arguments, whatever its subclass is.

    Physics, native threads, GL contexts and ONNX sessions do not travel between processes, so an unpickled environment
    is a new one that was never reset, as with `gymnasium.utils.EzPickle`. In contrast to that class the arguments are
    recorded before any constructor runs, so a subclass need not repeat them.
    """

    _constructor_arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """Remember the arguments."""
        instance = super().__new__(cls)
        instance._constructor_arguments = (args, dict(kwargs))
        return instance

    def __reduce__(self) -> tuple[Any, ...]:
        """Class, arguments, and the specification that `gym.make` attached."""
        args, kwargs = self._constructor_arguments
        return _rebuild, (type(self), args, kwargs), {"spec": getattr(self, "spec", None)}
