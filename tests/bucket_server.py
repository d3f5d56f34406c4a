"""A bucket on loopback that speaks as much of S3 as obstore does, and fails as real ones do."""

from __future__ import annotations

import base64
import hashlib
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from pathlib import Path
from socketserver import TCPServer
from typing import Any, Literal
from urllib.parse import parse_qs, unquote, urlsplit
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import pytest

from branchdrive.formats.object_client import connect

Fault = Literal["503", "403", "500", "cut", "hang", "ignores range", "ignores condition"]

_PAGE = 1000


@dataclass
class BucketServer:
    """What the server holds and saw.

    Attributes:
        objects: Content by key.
        faults: How requests for a key go wrong, one after the other; the last of them stays.
        requests: Method and key of every request, of a listing the key is empty.
        queries: Their queries.
        uploads: Parts of uploads that were begun, by number.
        numbers: Names of uploads to come.
        is_reversed: Whether keys are listed from the last to the first.
        page: Keys of a listing that one answer holds.
        released: Set when no request is to hang any longer.
        lock: Held while the state changes.
        checked: Keys of what was written with a checksum, which was right.
        written: How often a key was written.
        url: Where the server is.
    """

    objects: dict[str, bytes] = field(default_factory=dict)
    faults: dict[str, list[Fault | None]] = field(default_factory=dict)
    requests: list[tuple[str, str]] = field(default_factory=list)
    queries: list[dict[str, list[str]]] = field(default_factory=list)
    uploads: dict[str, dict[int, bytes]] = field(default_factory=dict)
    numbers: Iterator[int] = field(default_factory=count)
    is_reversed: bool = False
    page: int = _PAGE
    released: threading.Event = field(default_factory=threading.Event)
    lock: threading.Lock = field(default_factory=threading.Lock)
    written: Counter[str] = field(default_factory=Counter)
    checked: list[str] = field(default_factory=list)
    url: str = ""

    def fill(self, root: Path, prefix: str) -> None:
        """Put the files of a folder below a prefix."""
        for path in sorted(root.rglob("*")):
            if path.is_file():
                self.objects[f"{prefix}/{path.relative_to(root).as_posix()}"] = path.read_bytes()

    def num(self, method: str, part: str = "") -> int:
        """Requests of a method whose key holds `part`."""
        return sum(one == method and part in key for one, key in self.requests)

    def next_fault(self, key: str) -> Fault | None:
        """How the next request for a key goes wrong."""
        waiting = self.faults.get(key, [])
        if len(waiting) > 1:
            return waiting.pop(0)
        return waiting[0] if waiting else None


@contextmanager
def serving() -> Iterator[BucketServer]:
    """A server with a bucket called `bucket`."""
    state = BucketServer()
    server = _Server(("127.0.0.1", 0), type("Handler", (_Handler,), {"state": state}))
    state.url = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield state
    finally:
        state.released.set()
        server.shutdown()
        server.server_close()
        thread.join()


def use(server: BucketServer, patch: pytest.MonkeyPatch) -> None:
    """Let the environment name the server as where buckets are, and its credentials."""
    connect.cache_clear()
    patch.setenv("AWS_ENDPOINT_URL", server.url)
    patch.setenv("AWS_ACCESS_KEY_ID", "key-of-the-test")
    patch.setenv("AWS_SECRET_ACCESS_KEY", "secret-of-the-test")
    patch.setenv("AWS_REGION", "us-east-1")


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 64

    def server_bind(self) -> None:
        TCPServer.server_bind(self)  # that of `HTTPServer` looks the host's name up
        self.server_name, self.server_port = "localhost", int(self.server_address[1])

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Clients hang up, and are meant to."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    state: BucketServer

    def log_message(self, *arguments: Any) -> None:
        """Nothing is printed."""

    def _begin(self) -> tuple[str, dict[str, list[str]], bytes]:
        parts = urlsplit(self.path)
        bucket, _, key = unquote(parts.path).lstrip("/").partition("/")
        query = parse_qs(parts.query, keep_blank_values=True)
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        with self.state.lock:
            self.state.requests.append((self.command, "" if "list-type" in query else key))
            self.state.queries.append(query)
        if bucket != "bucket":
            self._answer(404, b"<Error><Code>NoSuchBucket</Code></Error>")
            return "", {}, b""
        return key, query, body

    def do_GET(self) -> None:
        key, query, _ = self._begin()
        if "list-type" in query:
            if not self._fails(""):
                self._list(query)
        elif key:
            self._get(key)

    def do_HEAD(self) -> None:
        key, _, _ = self._begin()
        self._get(key)

    def _fails(self, key: str) -> Fault | bool:
        """Fail as asked; returns the fault that is left to the caller."""
        with self.state.lock:
            fault = self.state.next_fault(key)
        if fault in ("503", "500", "403"):
            self._answer(int(fault), b"<Error><Code>Fault</Code><Message>secret-of-the-store</Message></Error>")
            return True
        if fault == "hang":
            self.state.released.wait(30)
            self.close_connection = True
            return True
        return fault or False

    def _get(self, key: str) -> None:
        fault = self._fails(key)
        if fault is True:
            return
        content = self.state.objects.get(key)
        if content is None:
            self._answer(404, b"<Error><Code>NoSuchKey</Code></Error>")
            return
        tag = _tag(content)
        wanted = self.headers.get("If-Match")
        if wanted not in (None, "*", tag) and fault != "ignores condition":
            self._answer(412, b"<Error><Code>PreconditionFailed</Code></Error>")
            return
        headers = {"ETag": tag, "Last-Modified": formatdate(1.7e9 + len(content), usegmt=True)}
        status, whole, ranged = 200, len(content), self.headers.get("Range")
        if ranged and fault != "ignores range":
            first, _, last = ranged.removeprefix("bytes=").partition("-")
            begin, end = (
                (whole - int(last), whole) if not first else (int(first), min(int(last or whole), whole - 1) + 1)
            )
            content, status = content[begin:end], 206
            headers["Content-Range"] = f"bytes {begin}-{end - 1}/{whole}"
        self._answer(status, content, headers, is_cut=fault == "cut")

    def _list(self, query: dict[str, list[str]]) -> None:
        prefix = query.get("prefix", [""])[0]
        keys = sorted((key for key in self.state.objects if key.startswith(prefix)), reverse=self.state.is_reversed)
        begin = int(query.get("continuation-token", ["0"])[0])
        page = keys[begin : begin + self.state.page]
        is_more = begin + len(page) < len(keys)
        rows = "".join(
            f"<Contents><Key>{escape(key)}</Key><LastModified>2023-11-14T22:13:20.000Z</LastModified>"
            f"<ETag>{escape(_tag(self.state.objects[key]))}</ETag><Size>{len(self.state.objects[key])}</Size></Contents>"
            for key in page
        )
        more = f"<NextContinuationToken>{begin + len(page)}</NextContinuationToken>" if is_more else ""
        self._answer(200, f"<ListBucketResult><IsTruncated>{str(is_more).lower()}</IsTruncated>{more}{rows}"
                          "</ListBucketResult>".encode())  # fmt: skip

    def do_PUT(self) -> None:
        key, query, body = self._begin()
        if not key or self._fails(key) is True:
            return
        checksum = self.headers.get("x-amz-checksum-sha256")
        if checksum is not None and checksum != base64.b64encode(hashlib.sha256(body).digest()).decode():
            self._answer(400, b"<Error><Code>BadDigest</Code></Error>")
            return
        with self.state.lock:
            if checksum is not None:
                self.state.checked.append(key)
            if "uploadId" in query:
                self.state.uploads[query["uploadId"][0]][int(query["partNumber"][0])] = body
                self._answer(200, b"", {"ETag": _tag(body)})
                return
            if not self._may_write(key):
                return
            self.state.objects[key] = body
            self.state.written[key] += 1
        self._answer(200, b"", {"ETag": _tag(body)})

    def _may_write(self, key: str) -> bool:
        there = self.state.objects.get(key)
        wanted = self.headers.get("If-Match")
        if (self.headers.get("If-None-Match") == "*" and there is not None) or (
            wanted is not None and (there is None or wanted != _tag(there))
        ):
            self._answer(412, b"<Error><Code>PreconditionFailed</Code></Error>")
            return False
        return True

    def do_POST(self) -> None:
        key, query, body = self._begin()
        if not key:
            self._answer(501, b"<Error><Code>NotImplemented</Code></Error>")
            return
        if self._fails(key) is True:
            return
        with self.state.lock:
            if "uploads" in query:
                upload = f"upload-{next(self.state.numbers)}"
                self.state.uploads[upload] = {}
                self._answer(200, f"<InitiateMultipartUploadResult><UploadId>{upload}</UploadId>"
                                  "</InitiateMultipartUploadResult>".encode())  # fmt: skip
                return
            if not self._may_write(key):
                return
            parts = self.state.uploads.pop(query["uploadId"][0])
            named = [
                int(number.text or 0) for number in ElementTree.fromstring(body).iter() if "PartNumber" in number.tag
            ]
            self.state.objects[key] = b"".join(parts[number] for number in named)
            self.state.written[key] += 1
            tag = _tag(self.state.objects[key])
        self._answer(200, f"<CompleteMultipartUploadResult><ETag>{escape(tag)}</ETag>"
                          "</CompleteMultipartUploadResult>".encode())  # fmt: skip

    def do_DELETE(self) -> None:
        key, query, _ = self._begin()
        with self.state.lock:
            if "uploadId" in query:
                self.state.uploads.pop(query["uploadId"][0], None)
            else:
                self.state.objects.pop(key, None)
        self._answer(204, b"")

    def _answer(
        self, status: int, content: bytes, headers: dict[str, str] | None = None, *, is_cut: bool = False
    ) -> None:
        self.send_response(status)
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        if status != 204:
            self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command == "HEAD":
            return
        self.wfile.write(content[: len(content) // 2] if is_cut else content)
        if is_cut:
            self.wfile.flush()
            self.close_connection = True


def _tag(content: bytes) -> str:
    return f'"{hashlib.md5(content).hexdigest()}"'
