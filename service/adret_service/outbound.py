"""Requests that the service sends to addresses that its users name, and to no others.

An address is used only if its host is on the operator's list. The name is resolved once, every
address behind it must be a public one, and the connection goes to the address that was checked, so
a name that changes its mind in between wins nothing. Redirects are not followed, no proxy of the
environment is used, and an answer's body is never read.
"""

import ipaddress
import socket
import time
from collections.abc import Iterable
from typing import Any
from urllib.parse import urlsplit

import httpcore

__all__ = ["Blocked", "Outbound"]

CONNECT = 5.0  # seconds
WHOLE = 15.0  # seconds for a whole exchange
PORTS = {"https": 443, "http": 80}
# Addresses that carry an IPv4 address inside, which could be anybody's.
TUNNELS = [ipaddress.ip_network(n) for n in ("64:ff9b::/96", "64:ff9b:1::/48", "2002::/16")]


class Blocked(OSError):
    """An address that must not be connected to."""


class Outbound:
    """Sends to hosts on a list.

    Parameters
    ----------
    hosts : str
        ``hooks.example.org, *.example.net, localhost:8081``: names, a wildcard for whatever is
        below a domain, a port where it is not the scheme's own. Empty: nothing is sent.
    allow_private : bool
        Whether plain HTTP and addresses that are not public may be used, too.
    """

    def __init__(self, hosts: str, *, allow_private: bool = False) -> None:
        self.hosts = [host.strip().lower() for host in hosts.split(",") if host.strip()]
        self.allow_private = allow_private

    def refusal(self, url: str) -> str | None:
        """Return what an address must be if this one is refused, else None.

        Examples
        --------
        >>> Outbound("*.example.org").refusal("https://hooks.example.org/done") is None
        True
        >>> Outbound("").refusal("https://hooks.example.org/done")
        'left out: this service calls nobody back'
        """
        if not self.hosts:
            return "left out: this service calls nobody back"
        schemes = "an http or https" if self.allow_private else "an https"
        limit = f"{schemes} address of a host that the service's operator has allowed"
        try:
            parts = urlsplit(url)
            port = parts.port
        except ValueError:
            return limit
        host = (parts.hostname or "").lower().rstrip(".")
        known = parts.scheme in (PORTS if self.allow_private else ("https",))
        if not url.isascii() or not url.isprintable() or " " in url or not known or not host:
            return limit
        if parts.username is not None or parts.password is not None or parts.fragment:
            return limit + ", without credentials or fragment"
        usual = port is None or port == PORTS[parts.scheme]
        wanted = host if usual else f"{host}:{port}"
        return None if any(_matches(wanted, allowed) for allowed in self.hosts) else limit

    def post(self, url: str, body: bytes, headers: Iterable[tuple[str, str]]) -> int:
        """Send a body and return the status of the answer.

        Raises
        ------
        OSError
            If the address is refused, or nobody answers there in time.
        """
        limit = self.refusal(url)
        if limit is not None:
            raise Blocked(f"address: must be {limit}")
        deadline = time.monotonic() + WHOLE
        backend = Guarded(deadline, allow_private=self.allow_private)
        sent = [(k.encode("ascii"), v.encode("ascii")) for k, v in headers]
        sent.append((b"Host", urlsplit(url).netloc.encode("ascii")))
        sent.append((b"Content-Length", str(len(body)).encode()))
        try:
            with (
                httpcore.ConnectionPool(network_backend=backend, retries=0) as pool,
                pool.stream("POST", url, headers=sent, content=body) as answer,
            ):
                return int(answer.status)
        except (httpcore.NetworkError, httpcore.TimeoutException, httpcore.ProtocolError) as error:
            raise OSError(f"{type(error).__name__}: {error}") from error


def _matches(host: str, allowed: str) -> bool:
    if allowed.startswith("*."):
        return host.endswith(allowed[1:]) and host != allowed[1:]
    return host == allowed


class Guarded(httpcore.NetworkBackend):
    """Connects to checked addresses only, and to nothing after a deadline."""

    def __init__(self, deadline: float, *, allow_private: bool) -> None:
        self._deadline = deadline
        self._allow_private = allow_private
        self._plain = httpcore.SyncBackend()

    def connect_tcp(
        self,
        host: str,
        port: int,
        timeout: float | None = None,
        local_address: str | None = None,
        socket_options: Any = None,
    ) -> httpcore.NetworkStream:
        """Resolve once, check, and connect to what was checked."""
        address = checked_address(host, port, allow_private=self._allow_private)
        stream = self._plain.connect_tcp(address, port, CONNECT, local_address, socket_options)
        return Timed(stream, self._deadline)


class Timed(httpcore.NetworkStream):
    """A connection whose every step ends at a deadline, however slowly the other side drips."""

    def __init__(self, stream: httpcore.NetworkStream, deadline: float) -> None:
        self._stream = stream
        self._deadline = deadline

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        """Read some bytes."""
        return self._stream.read(max_bytes, self._left())

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        """Write all bytes."""
        self._stream.write(buffer, self._left())

    def close(self) -> None:
        """Close the connection."""
        self._stream.close()

    def start_tls(
        self, ssl_context: Any, server_hostname: str | None = None, timeout: float | None = None
    ) -> httpcore.NetworkStream:
        """Go on in TLS, by the host's name."""
        secure = self._stream.start_tls(ssl_context, server_hostname, self._left())
        return Timed(secure, self._deadline)

    def get_extra_info(self, info: str) -> Any:
        """Ask the connection itself."""
        return self._stream.get_extra_info(info)

    def _left(self) -> float:
        left = self._deadline - time.monotonic()
        if left <= 0.0:
            raise httpcore.ReadTimeout("the other side took too long")
        return left


def checked_address(host: str, port: int, *, allow_private: bool) -> str:
    """Return the one address to connect to; every address of the name must be allowed.

    Raises
    ------
    Blocked
        If the name has no address, or one that is not public.
    """
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise Blocked(f"host: must have an address, got {host!r} ({error})") from None
    addresses = [str(entry[4][0]) for entry in found]
    for address in addresses:
        if not allow_private and not is_public(address):
            raise Blocked(f"host: must have public addresses, got {host!r}")
    return addresses[0]


def is_public(text: str) -> bool:
    """Whether an IP address is one of the public Internet.

    Examples
    --------
    >>> [is_public(a) for a in ("93.184.215.14", "10.0.0.1", "::ffff:127.0.0.1", "fe80::1%eth0")]
    [True, False, False, False]
    """
    address = ipaddress.ip_address(text.split("%", 1)[0])
    mapped = getattr(address, "ipv4_mapped", None)
    if mapped is not None:
        address = mapped
    if address.is_multicast or any(
        address in net for net in TUNNELS if net.version == address.version
    ):
        return False
    return address.is_global
