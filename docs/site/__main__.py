"""Build the site of these pages into `build/site`: `python -m docs.site`; a link that leads nowhere is an error.

Each version lies in a folder of its own, and `versions.json` beside them is what the selector of the theme reads: to
publish a version, put its folder beside those that are there and its line into that file.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib

from docs.site.links import broken_links
from docs.site.pages import ROOT, nav, site_files

from branchdrive.contract.resources import SPEC_VERSION

SOURCE, SITE = ROOT / "build" / "site-source", ROOT / "build" / "site"


def main() -> int:
    """Write the pages, let Zensical make the site, and follow every link of it."""
    for folder in (SOURCE, SITE):
        shutil.rmtree(folder, ignore_errors=True)
    files = site_files()
    for name, content in files.items():
        path = SOURCE / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    config = tomllib.loads((ROOT / "docs/site/zensical.toml").read_text("utf-8"))["project"]
    plugins = config["plugins"]["mkdocstrings"]["handlers"]["python"]
    plugins["paths"] = [str(ROOT / path) for path in plugins["paths"]]
    config |= {
        "nav": nav(config["nav"], list(files)),
        "docs_dir": SOURCE.name,
        "site_dir": f"{SITE.name}/{SPEC_VERSION}",
    }
    written = ROOT / "build" / "site.json"
    written.write_text(json.dumps(config, indent=1))
    done = subprocess.run([sys.executable, "-m", "zensical", "build", "--strict", "--clean", "-f", str(written)])
    if done.returncode:
        return done.returncode
    (SITE / "versions.json").write_text(json.dumps([{"version": SPEC_VERSION, "title": SPEC_VERSION, "aliases": []}]))
    (SITE / "index.html").write_text(
        f'<!doctype html><meta charset="utf-8"><title>BranchDrive</title>'
        f'<meta http-equiv="refresh" content="0; url={SPEC_VERSION}/index.html">'
        f'<a href="{SPEC_VERSION}/index.html">BranchDrive {SPEC_VERSION}</a>\n'
    )
    broken = list(broken_links(SITE))
    print(
        "\n".join(broken) or f"site: {SITE.relative_to(ROOT)}/index.html, {sum(1 for _ in SITE.rglob('*.html'))} pages"
    )
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
