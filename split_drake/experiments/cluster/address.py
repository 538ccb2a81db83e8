"""Where a scheduler is found, and whether others could give it orders."""

import ipaddress
import socket
import time
import warnings
from pathlib import Path

import dask
from distributed import Client

from split_drake.bad_input import BadInputError
from split_drake.files import read_json_object

SCHEMES = ("tcp", "tls", "ucx", "ws", "wss", "inproc")
_ENCRYPTED = ("tls", "wss", "inproc")
# How often it is tried whether a scheduler answers.
_PAUSE_S = 1.0


class NoSchedulerError(BadInputError):
    """No scheduler answers."""


class OpenSchedulerWarning(UserWarning):
    """A scheduler takes orders from anybody on its network."""


def address_of(scheduler: str) -> str:
    """Return the address of a scheduler: as it is, with tcp:// before it, or of a JSON file.

    The file is what `dask scheduler --scheduler-file` writes.

    Raises BadInputError where it is none.
    """
    if scheduler.endswith(".json"):
        fields = read_json_object(Path(scheduler), "a scheduler's file")
        scheduler = str(fields.get("address"))
    address = scheduler if "://" in scheduler else f"tcp://{scheduler}"
    scheme, _, place = address.partition("://")
    host, _, port = place.rpartition(":")
    named = all(host.strip("[]").split("."))
    if scheme not in SCHEMES or not named or not port.isdecimal() or int(port) > 65535:
        raise BadInputError(
            f"--scheduler is {scheduler!r}; expected local, an address such as "
            "tcp://10.0.0.5:8786, or the JSON file that dask scheduler --scheduler-file writes"
        )
    return address


def is_open(address: str) -> bool:
    """Return whether a scheduler could get orders from other machines, and asks for no key."""
    scheme, _, place = address.partition("://")
    return scheme not in _ENCRYPTED and not _is_loopback(place.rpartition(":")[0].strip("[]"))


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        pass
    try:
        found = {str(info[4][0]) for info in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return False
    return all(ipaddress.ip_address(each.partition("%")[0]).is_loopback for each in found)


def warn_if_open(address: str) -> None:
    """Warn where anybody on the scheduler's network could run code on its workers."""
    if is_open(address):
        warnings.warn(
            f"{address} is reached over a network without encryption: whoever reaches it can run "
            "code on its workers; see TLS in split_drake/experiments/cluster/README.md",
            OpenSchedulerWarning,
            stacklevel=2,
        )


def _require_keys(address: str) -> None:
    for name in ("ca-file", "client.cert", "client.key"):
        if not dask.config.get(f"distributed.comm.tls.{name}", None):
            raise BadInputError(
                f"{address} wants TLS, but Dask's setting distributed.comm.tls.{name} names no "
                "file; see TLS in split_drake/experiments/cluster/README.md"
            )


def connect(address: str, patience_s: float) -> Client:
    """Return a client of the scheduler, which may take so long to answer.

    TLS settings are Dask's own (`distributed.comm.tls`, from its files or the environment).

    Raises NoSchedulerError where none answers.
    """
    if address.startswith("tls"):
        _require_keys(address)
    end = time.monotonic() + patience_s
    while True:
        try:
            return Client(address, timeout=max(end - time.monotonic(), 2.0))
        except RuntimeError as error:
            raise BadInputError(f"{address} cannot be used: {error}") from error
        except (OSError, TimeoutError, ValueError) as error:
            if time.monotonic() + _PAUSE_S > end:
                raise NoSchedulerError(
                    f"no scheduler answers at {address} ({error}); expected one that was started "
                    "by dask scheduler, with the same version of Dask"
                ) from error
        time.sleep(_PAUSE_S)
