"""What files are damaged in, and who reads them."""

import pytest

from studies import runner
from tests.battery.faults.reader import Reader, Trial, prepare
from tests.helpers.tiny import STUDY
from tests.helpers.waves import interrupted


@pytest.fixture(scope="module", params=[prepare])
def reader(request):
    """A process that reads."""
    with Reader(request.param) as one:
        yield one


@pytest.fixture(scope="module")
def kept(reader, tmp_path_factory):
    """A result, and in `half` a run that was interrupted, with four points."""
    folder = tmp_path_factory.mktemp("kept")
    assert reader.ask(folder, "run", "tiny", "-q").code == 1
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.registry._registered", {"tiny": STUDY})
        patch.setattr("sweeps.plan.batches.BATCH_BYTES", 1.0)
        interrupted(runner.plan(STUDY, {}, folder / "half"), 4)
    return folder


@pytest.fixture
def trial(reader, kept, tmp_path):
    return Trial(reader, kept, tmp_path / "case")
