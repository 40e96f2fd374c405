"""What functions of tests note or are told, which is no part of their code: it cannot be compared."""


class _State:
    def __reduce_ex__(self, protocol):
        raise TypeError("it is compared by its type alone")


class Log(_State, list):
    """What was computed."""


class Told(_State, dict):
    """What decides what happens."""


class Chosen(_State, set):
    """Points of a kind."""
