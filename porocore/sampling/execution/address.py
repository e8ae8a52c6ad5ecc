"""Check of a dask scheduler's address, and that a scheduler answers there."""

from __future__ import annotations

import socket
import threading
from urllib.parse import urlsplit

from porocore.core.echo import cut, echo
from porocore.errors import ConfigurationError

#: Protocols of addresses whose host and port are tried here; an address without one is tcp.
SCHEMES = ("tcp", "tls", "ws", "wss")
#: Protocols that only dask can try.
OTHERS = ("inproc", "ucx", "ucxx")
#: Seconds to wait for an answer.
TIMEOUT = 3.0
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
    attempt.join(1.5 * TIMEOUT)
    if why:
        raise ConfigurationError(
            f"sampling.scheduler: no dask scheduler answers at {cut(address)} ({why[-1]}); start one with "
            "'dask scheduler', or leave the scheduler out to have workers on this machine"
        )


def _connect(host: str, port: int, why: list[str]) -> None:
    """Open and close a connection; clear ``why``, or add the reason of the failure."""
    try:
        socket.create_connection((host, port), timeout=TIMEOUT).close()
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
