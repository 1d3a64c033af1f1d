"""A Dask cluster of this machine for tests: `python dask_cluster.py WORKERS tcp|tls` prints its address, and ends when its standard input does.

And tasks that its workers can import.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from integration.scenectl_process import environment

NEEDS = "dask and distributed are not installed: they are an optional extra"


@contextmanager
def dask_cluster(workers: int, folder: Path, scheme: str = "tcp", **more: str) -> Iterator[str]:
    """Its address. Its workers lie in the folder, and are processes of one thread each. `more`: of their environment."""
    command = [sys.executable, __file__, str(workers), scheme]
    tests = Path(__file__).resolve().parent.parent
    paths = os.pathsep.join([str(tests), *filter(None, sys.path)])
    env = environment(
        None, PYTHONPATH=paths, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1", DASK_TEMPORARY_DIRECTORY=str(folder), **more
    )
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env, cwd=folder) as process:
        assert process.stdin is not None and process.stdout is not None
        try:
            address = process.stdout.readline().decode().strip()
            assert address.startswith(f"{scheme}://127.0.0.1:"), address
            yield address
        finally:
            process.stdin.close()
            process.wait(30)


def dies_once(mark: str) -> str:
    """Its worker's process ends the first time."""
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def always_dies() -> None:
    """Its worker's process ends each time."""
    os.kill(os.getpid(), signal.SIGKILL)


def nothing() -> None:
    """Of a render that has nothing to end."""


def main() -> None:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=int(sys.argv[1]),
        threads_per_worker=1,
        protocol=f"{sys.argv[2]}://",
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
