"""Modules that cannot be loaded without an extra which the tests do without are not looked through for examples."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("rerun") else ["branchdrive_reference/viewer/recording.py"]
