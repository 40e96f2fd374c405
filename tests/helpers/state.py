"""State shared with functions of tests, which does not count as their code since it cannot be compared."""


class _State:
    def __reduce_ex__(self, protocol):
        raise TypeError("it is compared by its type alone")


class Log(_State, list):
    """A log of computed points."""


class Told(_State, dict):
    """Instructions for a function."""


class Chosen(_State, set):
    """A set of points."""
