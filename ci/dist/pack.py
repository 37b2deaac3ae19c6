"""Packs a program for people without Rust: an archive with its checksum, npm packages, a Python wheel.

The same program gives the same bytes: files have no time of their own, and stand in order.
"""

import argparse
import base64
import gzip
import hashlib
import io
import json
import pathlib
import tarfile
import zipfile

# Rust's name of a target, npm's platform and processor, and the tag of wheels. Of Linux the glibc is the one that
# `cargo ci dist` links for.
TARGETS = {
    "x86_64-unknown-linux-gnu": ("linux", "x64", "manylinux_2_28_x86_64"),
    "aarch64-unknown-linux-gnu": ("linux", "arm64", "manylinux_2_28_aarch64"),
    "x86_64-apple-darwin": ("darwin", "x64", "macosx_11_0_x86_64"),
    "aarch64-apple-darwin": ("darwin", "arm64", "macosx_11_0_arm64"),
    "x86_64-pc-windows-msvc": ("win32", "x64", "win_amd64"),
}
ABOUT = "Tests for WGSL shaders: functions against references, frames against goldens, compute passes with a sanitizer"
LICENCE = "MIT OR Apache-2.0"


def targz(path, files):
    """A .tar.gz of (name, bytes, executable)."""
    with open(path, "wb") as out, gzip.GzipFile("", "wb", 9, out, mtime=0) as gz:
        with tarfile.open(fileobj=gz, mode="w", format=tarfile.USTAR_FORMAT) as tar:
            for name, data, executable in files:
                info = tarfile.TarInfo(name)
                info.size, info.mode = len(data), 0o755 if executable else 0o644
                tar.addfile(info, io.BytesIO(data))


def zipped(path, files):
    """A .zip of (name, bytes, executable)."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, data, executable in files:
            info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            info.create_system = 3
            info.external_attr = (0o100755 if executable else 0o100644) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, data)


def archive(out, stem, files, windows):
    """For people, who unpack it, and for cargo-binstall."""
    path = out / (stem + (".zip" if windows else ".tar.gz"))
    (zipped if windows else targz)(path, [(f"{stem}/{name}", data, x) for name, data, x in files])
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    path.with_name(path.name + ".sha256").write_text(f"{digest}  {path.name}\n")
    return path


def npm(out, version, target, program, files):
    """The package that people name, and the one of this platform."""
    system, processor, _ = TARGETS[target]
    here = pathlib.Path(__file__).parent
    common = {"version": version, "license": LICENCE, "engines": {"node": ">=18"}}
    name = f"karat-{system}-{processor}"
    others = {f"karat-{system}-{processor}": version for system, processor, _ in TARGETS.values()}
    main = {"name": "karat", "description": ABOUT, **common, "bin": {"karat": "karat.js"}}
    main["optionalDependencies"] = others
    own = {"name": name, "description": f"The program of karat for {system} on {processor}", **common}
    own.update({"os": [system], "cpu": [processor]})
    if system == "linux":
        own["libc"] = ["glibc"]
    text = lambda manifest: (json.dumps(manifest, indent=2) + "\n").encode()
    licences = [(f"package/{n}", data, False) for n, data, _ in files if n.startswith("LICENSE")]
    readme = [("package/README.md", dict((n, d) for n, d, _ in files)["README.md"], False)]
    paths = [out / f"karat-{version}.tgz", out / f"{name}-{version}.tgz"]
    launcher = ("package/karat.js", (here / "karat.js").read_bytes(), True)
    targz(paths[0], [("package/package.json", text(main), False), launcher, *readme, *licences])
    binary = (f"package/bin/{program.name}", program.read_bytes(), True)
    targz(paths[1], [("package/package.json", text(own), False), binary, *licences])
    return paths


def plugins(out, version, root, files):
    """Packages of JavaScript that run the program, the same on all platforms."""
    licences = [(f"package/{n}", data, False) for n, data, _ in files if n.startswith("LICENSE")]
    paths = []
    for name in ["vitest", "playwright"]:
        folder = root / "harness/npm" / name
        manifest = json.loads((folder / "package.json").read_text())
        # It runs the program of its own version.
        manifest["version"] = manifest["peerDependencies"]["karat"] = version
        own = [(path.name, path.read_bytes()) for path in sorted(folder.iterdir()) if path.name != "package.json"]
        own.append(("installed.js", (root / "harness/npm/installed.js").read_bytes()))
        text = (json.dumps(manifest, indent=2) + "\n").encode()
        path = out / f"{manifest['name']}-{version}.tgz"
        packed = [(f"package/{n}", data, False) for n, data in own]
        targz(path, [("package/package.json", text, False), *packed, *licences])
        paths.append(path)
    return paths


def wheel(out, version, target, program, files):
    """`pip install` and `uvx`: the program is a script of the wheel."""
    tag = f"py3-none-{TARGETS[target][2]}"
    # Python's form of `0.2.0-rc.1` is `0.2.0rc1`.
    head, _, rest = version.partition("-")
    version = head + rest.replace(".", "")
    info = f"karat-{version}.dist-info"
    readme = dict((n, d) for n, d, _ in files)["README.md"].decode()
    metadata = (
        f"Metadata-Version: 2.4\nName: karat\nVersion: {version}\nSummary: {ABOUT}\n"
        f"License-Expression: {LICENCE}\nRequires-Python: >=3.8\n"
        f"Description-Content-Type: text/markdown\n\n{readme}"
    )
    all_files = [
        (f"karat-{version}.data/scripts/{program.name}", program.read_bytes(), True),
        *[(f"{info}/licenses/{n}", data, False) for n, data, _ in files if n.startswith("LICENSE")],
        (f"{info}/METADATA", metadata.encode(), False),
        (f"{info}/WHEEL", f"Wheel-Version: 1.0\nGenerator: karat\nRoot-Is-Purelib: false\nTag: {tag}\n".encode(), False),
    ]
    digest = lambda data: base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
    record = "".join(f"{n},sha256={digest(data)},{len(data)}\n" for n, data, _ in all_files)
    all_files.append((f"{info}/RECORD", (record + f"{info}/RECORD,,\n").encode(), False))
    path = out / f"karat-{version}-{tag}.whl"
    zipped(path, all_files)
    return path


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    for name in ["binary", "root", "completions", "out"]:
        arguments.add_argument(f"--{name}", type=pathlib.Path, required=True)
    arguments.add_argument("--target", required=True, choices=sorted(TARGETS))
    arguments.add_argument("--version", required=True)
    given = arguments.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    program = given.binary
    beside = [(n, (given.root / n).read_bytes(), False) for n in ["LICENSE-APACHE", "LICENSE-MIT", "README.md"]]
    completions = sorted(given.completions.iterdir())
    # `cargo karat` runs the program beside it.
    cargo = program.with_name(program.name.replace("karat", "cargo-karat"))
    files = [(path.name, path.read_bytes(), True) for path in (program, cargo)] + beside
    files += [(f"completions/{path.name}", path.read_bytes(), False) for path in completions]
    stem = f"karat-{given.version}-{given.target}"
    made = [archive(given.out, stem, files, "windows" in given.target)]
    made += npm(given.out, given.version, given.target, program, files)
    made += plugins(given.out, given.version, given.root, files)
    made.append(wheel(given.out, given.version, given.target, program, files))
    for path in made:
        print(f"{path.stat().st_size:>10}  {path}")


main()
