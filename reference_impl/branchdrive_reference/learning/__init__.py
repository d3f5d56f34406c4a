"""Releases for learning with torch. Needs the extra ``branchdrive[models]``."""
