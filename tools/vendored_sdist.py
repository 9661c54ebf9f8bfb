"""A source archive that builds without a network, every crate inside: `make sdist`.

    python tools/vendored_sdist.py [FOLDER]

Writes sgpr-VERSION.tar.gz (as maturin makes it) and sgpr-VERSION-vendored.tar.gz to FOLDER, by default out/dist. Where
maturin is installed the second builds with `pip install --no-build-isolation --no-deps sgpr-VERSION-vendored.tar.gz`.
"""

import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONFIG = """\
[source.crates-io]
replace-with = "vendored-sources"

[source.vendored-sources]
directory = "vendor"
"""


def plain_sdist(out: Path) -> Path:
    """What maturin makes."""
    for old in out.glob("sgpr-*.tar.gz"):
        old.unlink()
    maturin = Path(sys.executable).with_name("maturin")
    manifest = ROOT / "crates" / "sgpr-py" / "Cargo.toml"
    subprocess.run([maturin, "sdist", "--manifest-path", manifest, "--out", out], check=True)
    (archive,) = out.glob("sgpr-*.tar.gz")
    return archive


def with_crates(archive: Path) -> Path:
    """The same with all crates of Cargo.lock, and the setting that has cargo take them."""
    name = archive.name.removesuffix(".tar.gz")
    target = archive.with_name(f"{name}-vendored.tar.gz")
    with tempfile.TemporaryDirectory() as place:
        with tarfile.open(archive) as packed:
            packed.extractall(place, filter="data")
        source = Path(place) / name
        # The archive lacks the benches: their crates leave the lock file, all others keep their version.
        locked = packages(source / "Cargo.lock")
        subprocess.run(["cargo", "vendor", "--quiet", "vendor"], cwd=source, check=True)
        assert packages(source / "Cargo.lock") <= locked, "cargo changed a version"
        (source / ".cargo").mkdir(exist_ok=True)
        (source / ".cargo" / "config.toml").write_text(CONFIG)
        beside = target.with_name(f".{target.name}")
        with tarfile.open(beside, "w:gz") as packed:
            packed.add(source, arcname=name)
        shutil.move(beside, target)
    return target


def packages(lock: Path) -> set[tuple[str, str]]:
    """Names and versions in a lock file."""
    return {(package["name"], package["version"]) for package in tomllib.loads(lock.read_text())["package"]}


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "out" / "dist"
    folder.mkdir(parents=True, exist_ok=True)
    plain = plain_sdist(folder)
    for path in (plain, with_crates(plain)):
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
