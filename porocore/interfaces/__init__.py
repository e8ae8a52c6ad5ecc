"""One abstract class for each exchangeable part, without implementations; ``__init__.pyi`` lists them."""

from porocore.core.lazy import lazy

__getattr__, __all__ = lazy(__name__, __file__)
