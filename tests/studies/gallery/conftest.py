"""What tests of the gallery share."""

import pytest

from studies import registry


@pytest.fixture(scope="session")
def computed():
    """A study's dataset by its name and values, without a file; what is recorded is given as `record`."""

    def run(name, record=(), **given):
        return registry.load(name).sweep(given, record=record).plan().run("sync")

    return run
