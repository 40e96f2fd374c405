"""Who may talk to the processes of a run: nobody but the run; and clusters that ask for certificates."""

import json
import subprocess
import sys

import dask
import distributed
import psutil
import pytest
import xarray as xr

from sweeps import SchedulerError
from sweeps.compute import cluster
from tests.helpers.processes.sweep_programs import make, undisturbed, values

pytestmark = pytest.mark.usefixtures("small_pieces")
# Tries every port as whoever has no key, or one of his own; says which let him in, and what web servers show him.
# It becomes somebody else, where it may, once everything is imported: he may not read what is installed.
INTRUDER = """
import asyncio, json, os, sys, urllib.error, urllib.request
import tornado.platform.asyncio  # Tornado itself imports it when there is a loop
from distributed import Security
from distributed.core import connect

def shown(port, page):
    try:
        return urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}", timeout=2).status == 200
    except (OSError, ValueError):
        return False

async def asked(address, arguments):
    comm = await connect(address, timeout=1, **arguments)
    await comm.write({"op": "identity", "reply": True})
    return isinstance(await comm.read(), dict)

async def enters(address, arguments):
    try:
        return await asyncio.wait_for(asked(address, arguments), 2)
    except (OSError, asyncio.TimeoutError):
        return False

async def main(ports):
    own = Security.temporary().get_connection_args("client")
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(65534)
        os.setuid(65534)
    tries = [(f"{how}://127.0.0.1:{port}", args) for port in ports for how, args in (("tcp", {}), ("tls", own))]
    entered = await asyncio.gather(*(enters(*each) for each in tries))
    found = [address for (address, _), is_in in zip(tries, entered) if is_in]
    pages = ("health", "info/main/workers.html", "json/counts.json", "metrics")
    return found + [f"{port}/{page}" for port in ports for page in pages if shown(port, page)]

print(json.dumps(asyncio.run(main(json.loads(sys.argv[1])))), flush=True)
os._exit(0)
"""


def listening():
    """Ports at which this process and its children listen."""
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    every = [each for process in processes for each in process.net_connections("tcp")]
    return sorted({each.laddr.port for each in every if each.status == psutil.CONN_LISTEN})


def intrude(ports):
    """What another process comes by at these ports."""
    done = subprocess.run(
        [sys.executable, "-c", INTRUDER, json.dumps(ports)],
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_nobody_else_reaches_the_processes_of_a_run():
    before, found = listening(), []

    def look(snapshot):
        if snapshot.done >= 4 and not found:
            ports = [port for port in listening() if port not in before]
            found.append((ports, intrude(ports)))

    data = make(points=24, pause=0.01).plan().run("processes", 2, look)
    ((ports, entered),) = found
    # The scheduler, two workers and their nannies, and some web servers.
    assert len(ports) >= 5
    assert entered == []
    xr.testing.assert_identical(values(data), undisturbed(24))


@pytest.fixture
def guarded(tmp_path):
    """The address of a scheduler that asks for a certificate, and Dask's configuration with one."""
    security, files = distributed.Security.temporary(), {}
    for name in ("tls_ca_file", "tls_client_cert", "tls_client_key"):
        files[name] = tmp_path / f"{name}.pem"
        files[name].write_text(getattr(security, name))
    ca, cert, key = map(str, files.values())
    tls = {"ca-file": ca, "client.cert": cert, "client.key": key}
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=2,
        processes=False,
        protocol="tls://",
        security=security,
        silence_logs=50,
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
    ) as one:
        yield one.scheduler_address, {f"distributed.comm.tls.{key}": value for key, value in tls.items()}


def test_a_scheduler_that_asks_for_certificates(tmp_path, guarded, monkeypatch):
    address, configuration = guarded
    assert address.startswith("tls://")
    with dask.config.set(configuration):  # or DASK_DISTRIBUTED__COMM__TLS__CA_FILE and its like
        make(points=24).plan(tmp_path / "powers.nc").run(address)
        xr.testing.assert_identical(values(make(points=24).plan().run(address)), undisturbed(24))
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    for wrong in (address, address.replace("tls", "tcp")):
        with pytest.raises(SchedulerError, match=r"^scheduler = .*: no Dask scheduler answers there") as caught:
            make(points=4).plan().run(wrong)
        assert ("under distributed.comm.tls" in str(caught.value)) == (wrong == address)
