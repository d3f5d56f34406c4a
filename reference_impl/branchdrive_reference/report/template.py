"""Templates, style and scripts as one page that fetches nothing.

Text of a dataset reaches a page in two ways alone: through templates, which escape it, and as JSON whose brackets are
escaped. The policy of the page names its own style and script by digest, so that nothing else runs, and forbids every
connection.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import Any

__all__ = ["asset", "island", "rendered_page"]

_SCRIPTS = ("decode.js", "theme.js", "gallery.js", "map.js", "chart.js", "faults.js", "player.js", "controls.js")
"""In the order in which they run."""

_WORD = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[-_.])(?=[^-_.])")
"""Places between the words of a name."""

_RULE = re.compile(r"\bBD-[A-Z]{3}-[0-9]{3}\b")


@cache
def asset(name: str) -> str:
    """Text of a file beside the code: a template, a style sheet or a script."""
    return files(__package__).joinpath("assets", name).read_text("utf-8")


@cache
def _environment() -> Any:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    found = Environment(
        loader=FunctionLoader(asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    found.filters["ticked"] = _ticked
    found.filters["rules_linked"] = _rules_linked
    found.filters["breakable"] = _breakable
    return found


def _ticked(text: str) -> Any:
    """Text with what stands in back-ticks as code; everything is escaped."""
    from markupsafe import Markup, escape

    parts = text.split("`")
    if len(parts) % 2 == 0:  # one is left over
        return escape(text)
    code = Markup("<code>{}</code>")
    return Markup("").join(code.format(part) if place % 2 else part for place, part in enumerate(parts))


def _rules_linked(text: str) -> Any:
    """Text with each rule that failed as a link to what is said of it; everything is escaped."""
    from markupsafe import Markup, escape

    return Markup(_RULE.sub(r'<a href="#\g<0>">\g<0></a>', str(escape(text))))  # noqa: S704  (escaped)


def _breakable(text: str, words: str = "") -> Any:
    """Text that a line may break between the words of.

    Args:
        text: What is escaped.
        words: Text with capitals whose words are those of `text`, which has it in other case.
    """
    from markupsafe import Markup, escape

    at = text.lower().find(words.lower()) if words else -1
    ends = {match.start() for match in _WORD.finditer(text)}
    if at >= 0:
        ends |= {at + match.start() for match in _WORD.finditer(words)}
    cuts = [0, *sorted(ends), len(text)]
    return Markup("<wbr>").join(escape(text[a:b]) for a, b in pairwise(cuts))


def island(document: Any) -> Any:
    """A document as the content of a script element that no browser runs: no bracket of it can end the element."""
    from markupsafe import Markup

    text = json.dumps(document, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))  # noqa: S704


def rendered_page(template: str, style: str, **values: Any) -> bytes:
    """A page as it is written.

    Args:
        template: Name of its file.
        style: Its style sheet.
        values: What the template is filled with.
    """
    from markupsafe import Markup

    script = "\n".join(["'use strict';", *map(asset, _SCRIPTS)])
    allowed = {name: base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
               for name, text in (("script", script), ("style", style))}  # fmt: skip
    policy = (
        "default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'; "
        f"script-src 'sha256-{allowed['script']}'; style-src 'sha256-{allowed['style']}'"
    )
    values |= {"policy": policy, "style": Markup(style), "script": Markup(script)}  # noqa: S704  (our own)
    text: str = _environment().get_template(template).render(values)
    return text.encode()
