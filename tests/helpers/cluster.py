"""A cluster of Dask's scheduler and workers on this machine, whose processes tests may kill."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from socket import socket

ROOT = Path(__file__).parents[2]
_START_S = 60.0


def free_port() -> int:
    with socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


class Cluster:
    """A scheduler on the loopback and workers of one thread each.

    Args:
        folder: in which workers run, and keep what they write; the logs lie there.
        settings: more environment, Dask's own settings say.
        arguments: more of scheduler and workers.
        scheme: tcp or tls.
    """

    def __init__(
        self,
        folder: Path,
        settings: Mapping[str, str] | None = None,
        arguments: Sequence[str] = (),
        scheme: str = "tcp",
    ) -> None:
        self._folder, self._arguments = folder, tuple(arguments)
        self._environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "OMP_NUM_THREADS": "1",
            "OMP_WAIT_POLICY": "PASSIVE",
            **(settings or {}),
        }
        self._port, self._scheme = free_port(), scheme
        self.address = f"{scheme}://127.0.0.1:{self._port}"
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    def start_scheduler(self) -> None:
        self.scheduler = self._run(
            "scheduler", f"--port={self._port}", "--host=127.0.0.1", *self._protocol()
        )

    def _protocol(self) -> tuple[str, ...]:
        return () if self._scheme == "tcp" else (f"--protocol={self._scheme}",)

    def start_worker(self) -> None:
        """Start a worker without a nanny, so that killing it leaves nothing behind."""
        self.workers.append(
            self._run("worker", self.address, "--nthreads=1", "--no-nanny", *self._protocol())
        )

    def _run(self, kind: str, *arguments: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "distributed.cli.dask_" + kind, "--no-dashboard"]
        number = len(self.workers)
        with (self._folder / f"{kind}-{number}.log").open("ab") as log:
            return subprocess.Popen(
                [*command, *arguments, *self._arguments],
                cwd=self._folder,
                env=self._environment,
                stdout=log,
                stderr=log,
            )

    def kill_scheduler(self) -> None:
        assert self.scheduler is not None
        self.scheduler.send_signal(signal.SIGKILL)
        self.scheduler.wait()

    def kill_worker(self) -> None:
        """Kill the worker that is there for longest."""
        worker = self.workers.pop(0)
        worker.send_signal(signal.SIGKILL)
        worker.wait()

    def end(self) -> None:
        for process in (*self.workers, self.scheduler):
            if process is not None:
                process.kill()
                process.wait()

    def logs(self) -> str:
        return "\n".join(path.read_text() for path in sorted(self._folder.glob("*.log")))


def wait_until(happened: "object", limit_s: float = _START_S) -> None:
    """Wait until a function returns something true; fail where it takes too long."""
    assert callable(happened)
    end = time.monotonic() + limit_s
    while not happened():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.1)
