"""Workers of a dask scheduler or a local cluster (DaskBackend).

States are not left to dask's scheduler to place: each worker is handed one at a time, so that a worker that dies or
hangs is blamed for that state only, and none waits behind another.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from importlib import import_module
from importlib.metadata import version
from typing import Any
from urllib.parse import urlsplit

from porocore.core.echo import cut, echo
from porocore.core.parallel.children import interrupts_blocked, script_left_out
from porocore.core.parallel.memory import THREAD_VARIABLES, one_thread_in_children
from porocore.errors import ConfigurationError, PluginError, PorocoreError
from porocore.sampling.execution.tasks import ExecutorWorker, Ready, Worker, WorkerBackend

#: Protocols of addresses whose host and port are tried here; an address without one is tcp.
SCHEMES = ("tcp", "tls", "ws", "wss")
#: Protocols that only dask can try.
OTHERS = ("inproc", "ucx", "ucxx")
#: Seconds to wait for an answer.
ANSWER_TIMEOUT = 3.0
EXAMPLE = "expected the address of a dask scheduler such as tcp://node:8786"


def check_reachable(address: str) -> None:
    """Open a connection to the address of a scheduler and close it again.

    Raises
    ------
    ConfigurationError
        The text is no address, or no scheduler answers there.
    """
    scheme, between, _ = address.partition("://")
    if between and scheme in OTHERS:
        return
    host, port = _host_and_port(address if between else f"tcp://{address}")
    why = ["no answer in time"]
    # The lookup of a name has no time limit of its own.
    attempt = threading.Thread(target=_connect, args=(host, port, why), daemon=True)
    attempt.start()
    attempt.join(1.5 * ANSWER_TIMEOUT)
    if why:
        raise ConfigurationError(
            f"sampling.scheduler: no dask scheduler answers at {cut(address)} ({why[-1]}); start one with "
            "'dask scheduler', or leave the scheduler out to have workers on this machine"
        )


def _connect(host: str, port: int, why: list[str]) -> None:
    """Open and close a connection; clear ``why``, or add the reason of the failure."""
    try:
        socket.create_connection((host, port), timeout=ANSWER_TIMEOUT).close()
    except (OSError, UnicodeError) as error:
        why.append(str(getattr(error, "strerror", None) or error))
    else:
        why.clear()


def _host_and_port(address: str) -> tuple[str, int]:
    refused = f"sampling.scheduler: {EXAMPLE}, got {echo(address.removeprefix('tcp://'))}"
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise ConfigurationError(f"{refused}, whose port is no number up to 65535") from None
    if parts.scheme not in SCHEMES:
        raise ConfigurationError(f"{refused}; of the protocols, dask knows {', '.join((*SCHEMES, *OTHERS))}")
    if not host or not port or any(c.isspace() for c in host):
        raise ConfigurationError(f"{refused}; host and port are needed")
    return host, port


#: Seconds between two queries of the workers.
LOOK_INTERVAL = 0.5
#: Time limit for reaching a scheduler [s].
SCHEDULER_TIMEOUT = 20
#: Time limit for the end of workers [s].
FAREWELL = 10


class DaskBackend(WorkerBackend):
    """All workers of a scheduler, including those that join later.

    Parameters
    ----------
    scheduler
        Address such as ``tcp://node:8786``; None: a cluster of processes on this machine, which ends with them.
    count
        Number of those processes.

    Raises
    ------
    PluginError
        dask.distributed is not installed.
    ConfigurationError
        The text is no address, or no scheduler answers there.
    PorocoreError
        No scheduler answers at the address.
    """

    def __init__(self, scheduler: str | None, count: int) -> None:
        try:
            distributed = import_module("distributed")
        except ImportError as error:
            raise PluginError(
                f"executor 'dask' needs dask.distributed, which cannot be imported here ({error}); pip install "
                "distributed"
            ) from error
        self._cluster: Any = None
        self._script_left_out = ExitStack()
        self._address = scheduler or ""
        self._count = count
        super().__init__()
        self._known: dict[str, ExecutorWorker] = {}
        self._threads: dict[str, int] = {}
        self._looked = -LOOK_INTERVAL
        self._processes: dict[str, int] = {}
        # What matters is raised, or a warning of these workers.
        for name in [name for name in logging.root.manager.loggerDict if name.split(".")[0] == "distributed"]:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        if scheduler is None:
            self._cluster = self._start_cluster(distributed, count)
            self._address = self._cluster.scheduler_address
        else:
            check_reachable(scheduler)
        try:
            with interrupts_blocked():
                self._client = distributed.Client(
                    self._address, timeout=SCHEDULER_TIMEOUT, set_as_default=False, name="porocore"
                )
        except Exception as error:  # dask raises anything when another program answers
            raise PorocoreError(
                f"no dask scheduler answers at {self._address} ({' '.join(str(error).split())}); start one with "
                "'dask scheduler', or leave out --scheduler to have workers on this machine"
            ) from error
        try:
            self._look()
        except BaseException:
            self.close()
            raise

    def _start_cluster(self, distributed: Any, count: int) -> Any:
        """Return a cluster of processes on this machine."""
        # Without dask's setting of malloc, which makes every larger array anew from the system.
        environment = {"distributed.nanny.pre-spawn-environ": dict.fromkeys(THREAD_VARIABLES, "1")}
        settings = import_module("dask").config.set(environment)
        with ExitStack() as stack, settings, one_thread_in_children(), interrupts_blocked():
            stack.enter_context(script_left_out())
            cluster = distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
            # Until the cluster is closed: a dead worker is started again at any time.
            self._script_left_out = stack.pop_all()
        return cluster

    @property
    def warnings(self) -> list[str]:
        """Warnings of a scheduler without workers, and of workers with several threads."""
        found = []
        if not self._known:
            found.append(
                f"the dask scheduler at {self._address} has no workers; waiting for the first one to join"
            )
        several = [f"{name} ({n})" for name, n in self._threads.items() if n > 1]
        if several:
            found.append(
                f"dask workers with several threads solve one state at a time all the same: {', '.join(several)}; "
                "start as many workers as cores, each with --nthreads 1"
            )
        return found

    def workers(self) -> Sequence[Worker]:
        """Return the present workers, looked up twice a second."""
        if time.monotonic() - self._looked >= LOOK_INTERVAL:
            self._look()
        return list(self._known.values())

    @property
    def slots(self) -> int:
        """One slot for each worker."""
        return max(1, len(self._known))

    def lost(self, worker: Worker) -> None:
        """Remove the worker; its nanny, or whoever started it, replaces it."""
        self._known = {name: known for name, known in self._known.items() if known is not worker}
        self._looked = -LOOK_INTERVAL

    def check(self, ready: Ready) -> list[str]:
        """Refuse a worker with another porocore; warn of one whose libraries use several threads."""
        if self._cluster is not None:
            self._processes[f"{ready.host} {ready.process}"] = ready.process
        own = version("porocore")
        if ready.version != own:
            raise PluginError(
                f"the dask workers on {ready.host} have porocore {ready.version}, this process has {own}; "
                "install the same version there"
            )
        if "1" not in ready.threads:
            return [
                f"a dask worker on {ready.host} leaves the number of threads to its libraries, so that workers may "
                f"fight over cores: start workers with a nanny (the default), or with {THREAD_VARIABLES[0]}=1"
            ]
        return []

    def close(self) -> None:
        """Leave the scheduler and end a local cluster."""
        with suppress(Exception):  # it may be gone already
            self._client.close(timeout=FAREWELL)
        if self._cluster is not None:
            with suppress(Exception):
                self._cluster.close(timeout=FAREWELL)
        self._script_left_out.close()

    def abort(self) -> None:
        """Leave without waiting for running solves; on a scheduler of the user they go on and are dropped."""
        if self._cluster is not None:
            for nanny in self._cluster.workers.values():
                nanny.auto_restart = False
            for process in self._processes.values():
                with suppress(OSError):  # it has ended; on Windows any signal ends it
                    os.kill(process, getattr(signal, "SIGKILL", signal.SIGTERM))
        self.close()

    def _look(self) -> None:
        try:
            if self._client.status != "running":
                raise OSError(f"the connection is {self._client.status}")
            self._threads = dict(self._client.nthreads())
        except Exception as error:
            raise PorocoreError(
                f"the dask scheduler at {self._address} has gone ({' '.join(str(error).split())}); finished states are "
                "kept: start it again and resume"
            ) from error
        self._looked = time.monotonic()
        for name in self._threads:
            if name not in self._known:
                executor = self._client.get_executor(
                    workers=[name], allow_other_workers=False, pure=False, retries=0
                )
                self._known[name] = ExecutorWorker(executor, urlsplit(name).hostname or name)
        self._known = {name: worker for name, worker in self._known.items() if name in self._threads}
