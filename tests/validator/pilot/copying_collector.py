"""A collector that copies finished groups into a dataset, one shard each, with one mistake or none.

Usage: ``copying_collector.py SOURCE OUT MISTAKE GROUPS DIES``. `SOURCE` holds a folder of tables for each group and the
descriptor, `GROUPS` is a list of ids with commas or ``all``. Where the folder `OUT` is called `DIES`, the process kills
itself in its second group, once.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from pathlib import Path


def main(source: Path, out: Path, mistake: str, groups: str, dies: str) -> int:
    every = sorted(path.name for path in source.iterdir() if path.is_dir())
    wanted = every if groups == "all" else groups.split(",")
    out.mkdir(exist_ok=True)
    begun = out.parent / f"{out.name}.begun"
    lock = out.parent / f"{out.name}.lock"
    if mistake == "lock":
        if lock.exists():
            sys.stderr.write("another collector is at work\n")
            return 1
        lock.touch()
    done = begun.read_text().split() if mistake == "begun" and begun.exists() else []
    num_before, last = 0, ""
    for name in wanted:
        shard = out / "raw" / f"shard-{every.index(name):05d}"
        if shard.exists() or name in done:
            continue
        with begun.open("a") as stream:
            stream.write(f"{name}\n")
        aside = out.parent / f"{out.name}.aside"
        shutil.rmtree(aside, ignore_errors=True)
        shutil.copytree(source / name, aside)
        died = out.parent / f"{out.name}.died"
        if out.name == dies and num_before == 1 and not died.exists():
            died.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        off = {"process": os.getpid(), "seed": num_before, "order": last > name}.get(mistake, 0)
        if off:
            _disturb(aside / "observations.parquet", float(off))
        shard.parent.mkdir(exist_ok=True)
        aside.rename(shard)
        num_before, last = num_before + 1, name
    shutil.copy(source / "branchdrive.json", out)
    from branchdrive.formats.folder import Folder
    from branchdrive.formats.manifest import build_manifest

    (out / "MANIFEST.sha256").write_bytes(build_manifest(Folder(out)).render())
    return 0


def _disturb(path: Path, off: float) -> None:
    """Change speeds from tick 50 on."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    from branchdrive.formats.parquet import encode_table

    table = pq.read_table(path)
    speed = table["speed_mps"].to_numpy() + np.where(table["tick"].to_numpy() >= 50, 1e-5 * (off % 97), 0)
    place = table.schema.get_field_index("speed_mps")
    table = table.set_column(place, table.schema.field(place), pa.array(speed.astype(np.float32)))
    path.write_bytes(encode_table(table))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], *sys.argv[4:6]))
