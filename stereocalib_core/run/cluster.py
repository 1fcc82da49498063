"""The Dask cluster of a batch: a local one that speaks TLS with certificates of its own, or a scheduler that runs."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereocalib_core.config.running import CLOSE_TIMEOUT_S, CONNECT_TIMEOUT_S, HURRY_S
from stereocalib_core.errors import ConfigError


@dataclass(frozen=True)
class Scheduler:
    """A running Dask scheduler, and for `tls://` the files (PEM) that prove to each other who is who."""

    address: str
    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        given = [path for path in (self.ca, self.cert, self.key) if path is not None]
        if self.address.startswith("tls://") != (len(given) == 3) or 0 < len(given) < 3:
            remedy = "tls://HOST:PORT goes with --tls-ca, --tls-cert and --tls-key"
            raise ConfigError("certificates and address do not match", self.address, remedy)
        for path in given:
            if not path.is_file():
                raise ConfigError("no such certificate or key", path, "name a PEM file")

    @property
    def note(self) -> str | None:
        """What whoever chose this address should know of it."""
        host = self.address.removeprefix("tcp://").rpartition(":")[0].strip("[]")
        if not self.address.startswith("tcp://") or host == "localhost" or _is_loopback(host):
            return None
        return (
            f"{self.address} is not encrypted: anyone on the way can read the drives and run code on the workers; "
            "use tls:// with --tls-ca, --tls-cert and --tls-key"
        )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def usable_cores() -> list[int]:
    """The cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


@contextlib.contextmanager
def cluster(workers: int | None, scheduler: Scheduler | None, drives: int) -> Iterator[Any]:
    """A client of that scheduler, or of a local cluster that lives as long as the batch."""
    try:
        import distributed
    except ImportError as error:
        raise ConfigError("batch needs Dask", "not installed", "pip install 'stereocalib[batch]'") from error
    if scheduler is not None:
        with _remote_client(distributed, scheduler) as client:
            yield client
        return
    with _memory_kept():
        local = distributed.LocalCluster(
            n_workers=workers or min(len(usable_cores()), drives),
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            protocol="tls://",
            security=distributed.Security.temporary(),
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
            env={"NUMBA_NUM_THREADS": "1"},
        )
    client = distributed.Client(local)
    patience_s = CLOSE_TIMEOUT_S
    try:
        yield client
    except KeyboardInterrupt:
        patience_s = HURRY_S
        _kill_workers(local)  # a worker would finish its drive and only then listen
        raise KeyboardInterrupt("the same call goes on from here") from None
    finally:
        for part in (client, local):
            # the drives are done; what is left ends with this process
            with contextlib.suppress(TimeoutError):
                part.close(timeout=patience_s)


@contextlib.contextmanager
def _memory_kept() -> Iterator[None]:
    """Workers that are made now keep memory that they have freed for what comes next, as any other process does.

    Dask tells theirs to give it back at once. Pictures come and go in every frame, and the system then clears every
    page of them anew: a third of a frame's time.
    """
    import dask

    place, trim = "distributed.nanny.pre-spawn-environ", "MALLOC_TRIM_THRESHOLD_"
    kept = {name: value for name, value in dask.config.get(place, {}).items() if name != trim}
    with dask.config.set({place: kept}):
        yield


def _remote_client(distributed: Any, scheduler: Scheduler) -> Any:
    security = None
    if scheduler.ca is not None:
        security = distributed.Security(
            tls_ca_file=str(scheduler.ca),
            tls_client_cert=str(scheduler.cert),
            tls_client_key=str(scheduler.key),
            require_encryption=True,
        )
    try:
        return distributed.Client(scheduler.address, timeout=CONNECT_TIMEOUT_S, security=security)
    except (OSError, ValueError, TypeError) as error:
        remedy = "check the address, tcp://HOST:PORT or tls://HOST:PORT, and the certificates"
        raise ConfigError("no Dask scheduler", scheduler.address, remedy) from error


def _kill_workers(cluster: Any) -> None:
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        if nanny.pid:
            os.kill(nanny.pid, signal.SIGKILL)
