"""A folder whose files run as soon as somebody imports a module by a common name, and say so."""

from __future__ import annotations

from pathlib import Path

__all__ = ["hostile_folder", "infest"]

MARK = "EXECUTED"
"""How the files begin that hostile code leaves behind, beside itself."""

_MODULES = (
    "re", "pickle", "struct", "numpy", "json", "sitecustomize", "usercustomize", "selectors", "signal", "threading",
    "multiprocessing", "pyarrow", "torch", "numba", "pymunk", "cvxpy", "matplotlib", "logging", "branchdrive",
    "branchdrive_reference", "_bootlocale", "rich", "yaml", "scipy", "pandas",
)  # fmt: skip
_PACKAGES = ("concurrent", "importlib", "encodings", "ctypes", "asyncio", "collections", "email", "jsonschema")

_CODE = "import os\nopen(os.path.join({folder!r}, 'EXECUTED-' + __name__), 'w').close()\nraise SystemExit(99)\n"

_ENTRY_POINTS = """[branchdrive.commands]
validate = pickle
collect = re
hostile = struct

[branchdrive.leakage]
agru = json:classifier

[numba_extensions]
init = numba:init

[pydantic]
plugin = json:plugin
"""
