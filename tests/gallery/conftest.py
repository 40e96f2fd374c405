"""What tests of the gallery share."""

import pytest

from studies import registry
from studies.asking.sweep import sweep_of


@pytest.fixture(scope="session")
def computed():
    """A study's dataset by its name and values, without a file; recorded series are given as `record`."""

    def run(name, record=(), **values):
        study = registry.load(name)
        rate = None if "sample_rate" in study.parameters else values.pop("sample_rate", None)
        return sweep_of(study, values, record=record, sample_rate=rate).plan().run("sync")

    return run
