"""HTTP/1.1 by a parser in C, which sets no limit on the head of a request: here is one."""

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

__all__ = ["BoundedHttp"]

LARGEST_HEAD = 64 << 10  # bytes


class BoundedHttp(HttpToolsProtocol):
    """A connection that is closed with 400 when a head, or what frames a body, has no end."""

    unframed = 0  # bytes that came since something of a request was last complete

    def data_received(self, data: bytes) -> None:
        """Take bytes from the client."""
        self.unframed += len(data)
        super().data_received(data)
        if self.unframed > LARGEST_HEAD and not self.transport.is_closing():
            self.send_400_response("Invalid HTTP request received.")

    def on_headers_complete(self) -> None:
        """Begin the request, unless its head is too long."""
        head = len(self.url) + sum(len(name) + len(value) + 4 for name, value in self.headers)
        if head > LARGEST_HEAD:
            raise ValueError(f"head: must be at most {LARGEST_HEAD} bytes, got {head}")
        self.unframed = 0
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Take a piece of the body."""
        self.unframed = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        """End the request."""
        self.unframed = 0
        super().on_message_complete()
