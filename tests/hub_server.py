"""A hub on loopback that answers what is asked of the Hugging Face Hub about repositories of kind `dataset`.

Made after what `huggingface_hub` asks for and reads; no answer was compared with the Hub itself.
"""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlsplit

import pytest

from branchdrive.formats.object_client import connect

NAME = "org/name"
TOKEN = "hf_token-of-the-test"

_API = re.compile(r"/api/datasets/org/name/(revision|tree|paths-info)/([^/?]+)(?:/([^?]*))?")
_FILE = re.compile(r"/datasets/org/name/resolve/([0-9a-f]{40})/([^?]+)")


@dataclass
class HubServer:
    """One repository, `NAME`, and the server that its large files are redirected to.

    Attributes:
        commits: Files by path, of each commit.
        branches: Commits by name of a branch, tag or pull request.
        large: Bytes from which on a file is served elsewhere.
        page: Files of a listing that one answer holds.
        is_private: Whether the token is needed.
        status: What every question is answered with, or what each of the next ones is.
        requests: Method and path of every request to the hub.
        elsewhere: Headers of requests to the other server, by path.
        url: Where the hub is.
        store_url: Where the other server is.
    """

    commits: dict[str, dict[str, bytes]] = field(default_factory=dict)
    branches: dict[str, str] = field(default_factory=dict)
    large: int = 1000
    page: int = 1000
    is_private: bool = False
    status: dict[str, int] = field(default_factory=dict)
    requests: list[tuple[str, str]] = field(default_factory=list)
    elsewhere: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    url: str = ""
    store_url: str = ""

    def commit(self, files: dict[str, bytes], branch: str = "main") -> str:
        """Make a commit of these files, to which a branch then points."""
        name = hashlib.sha1(json.dumps([len(self.commits), sorted(files)]).encode()).hexdigest()
        self.commits[name], self.branches[branch] = dict(files), name
        return name

    def fill(self, root: Path, folder: str = "") -> str:
        """Make a commit of the files below a folder."""
        below = f"{folder}/" if folder else ""
        paths = [path for path in sorted(root.rglob("*")) if path.is_file()]
        return self.commit({f"{below}{path.relative_to(root).as_posix()}": path.read_bytes() for path in paths})


@contextmanager
def serving() -> Iterator[HubServer]:
    """A hub with an empty repository, and the server of its large files."""
    state = HubServer()
    servers = [
        ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (kind,), {"state": state})) for kind in (_Hub, _Elsewhere)
    ]
    state.url, state.store_url = (f"http://127.0.0.1:{server.server_address[1]}" for server in servers)
    threads = [
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True) for server in servers
    ]
    for thread in threads:
        thread.start()
    try:
        yield state
    finally:
        for server, thread in zip(servers, threads, strict=True):
            server.shutdown()
            server.server_close()
            thread.join()


def use(server: HubServer, patch: pytest.MonkeyPatch) -> None:
    """Let this process and those that it starts take the server for the Hub, without a token."""
    from huggingface_hub import constants

    connect.cache_clear()
    patch.setattr(constants, "ENDPOINT", server.url)
    patch.setattr(constants, "HF_TOKEN_PATH", "/nowhere/token")
    patch.setenv("HF_ENDPOINT", server.url)
    patch.setenv("HF_TOKEN_PATH", "/nowhere/token")
    for name in ("HF_TOKEN", "HUGGING_FACE_HUB_TOKEN"):
        patch.delenv(name, raising=False)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    state: HubServer

    def log_message(self, *arguments: Any) -> None:
        """Nothing is printed."""

    def _answer(self, status: int, content: bytes = b"", headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def _serve(self, content: bytes) -> None:
        """A file, or the part of it that is asked for."""
        ranged = self.headers.get("Range")
        if not ranged:
            self._answer(200, content)
            return
        first, _, last = ranged.removeprefix("bytes=").partition("-")
        part = content[int(first) : int(last) + 1]
        place = f"bytes {first}-{int(first) + len(part) - 1}/{len(content)}"
        self._answer(206, part, {"Content-Range": place})


class _Hub(_Handler):
    def do_GET(self) -> None:
        self._begin()

    def do_HEAD(self) -> None:
        self._begin()

    def do_POST(self) -> None:
        self._begin()

    def _begin(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        parts = urlsplit(self.path)
        self.state.requests.append((self.command, parts.path))
        api, file = _API.fullmatch(parts.path), _FILE.fullmatch(parts.path)
        kind = api[1] if api else "file"
        if kind in self.state.status:
            self._answer(self.state.status[kind], b"secret-of-the-hub")
        elif self.state.is_private and self.headers.get("Authorization") != f"Bearer {TOKEN}":
            self._answer(401, b"{}", {"X-Error-Code": "RepoNotFound"} if api else {})
        elif api:
            self._tell(kind, unquote(api[2]), unquote(api[3] or ""), parse_qs(parts.query), body)
        elif file:
            self._file(file[1], unquote(file[2]))
        else:
            self._answer(404, b"{}", {"X-Error-Code": "RepoNotFound"})

    def _tell(self, kind: str, revision: str, folder: str, query: dict[str, list[str]], body: bytes) -> None:
        commit = self.state.branches.get(revision, revision)
        files = self.state.commits.get(commit)
        if files is None:
            self._answer(404, b"{}", {"X-Error-Code": "RevisionNotFound"})
        elif kind == "revision":
            self._json({"id": NAME, "sha": commit})
        elif kind == "paths-info":
            wanted = [value for values in parse_qs(body.decode()).values() for value in values]
            named = json.loads(body)["paths"] if body.startswith(b"{") else wanted
            self._json([_entry(path, files[path]) for path in named if path in files])
        else:
            self._tree(files, folder, query)

    def _tree(self, files: dict[str, bytes], folder: str, query: dict[str, list[str]]) -> None:
        below = {path: content for path, content in files.items() if not folder or path.startswith(f"{folder}/")}
        if folder and not below:
            self._answer(404, b"{}", {"X-Error-Code": "EntryNotFound"})
            return
        folders = {path.rpartition("/")[0] for path in below} - {""}
        rows = [{"type": "directory", "oid": "0" * 40, "size": 0, "path": path} for path in sorted(folders)]
        rows += [_entry(path, content) for path, content in sorted(below.items())]
        begin = int(query.get("cursor", ["0"])[0])
        end = begin + self.state.page
        path = urlsplit(self.path).path
        more = {"Link": f'<{self.state.url}{path}?recursive=true&cursor={end}>; rel="next"'} if end < len(rows) else {}
        self._json(rows[begin:end], more)

    def _file(self, commit: str, path: str) -> None:
        content = self.state.commits.get(commit, {}).get(path)
        if content is None:
            self._answer(404, b"Entry not found", {"X-Error-Code": "EntryNotFound"})
        elif len(content) >= self.state.large:
            where = f"{self.state.store_url}/{commit}/{quote(path)}?signature=signature-of-the-test"
            self._answer(302, headers={"Location": where})
        else:
            self._serve(content)

    def _json(self, content: object, headers: dict[str, str] | None = None) -> None:
        self._answer(200, json.dumps(content).encode(), {"Content-Type": "application/json"} | (headers or {}))


class _Elsewhere(_Handler):
    def do_GET(self) -> None:
        parts = urlsplit(self.path)
        commit, _, path = unquote(parts.path).lstrip("/").partition("/")
        self.state.elsewhere.append((path, dict(self.headers.items())))
        self._serve(self.state.commits[commit][path])


def _entry(path: str, content: bytes) -> dict[str, object]:
    return {"type": "file", "oid": hashlib.sha1(content).hexdigest(), "size": len(content), "path": path}
