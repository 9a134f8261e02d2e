#!/usr/bin/env python3
"""Packages every crate that is published, compiles them from the packages alone, and checks metadata, contents and size.

Cargo packages crates of one workspace that depend on each other in dependency order, as if the earlier ones were in the
registry already. Its own verification would build every dependency once for each crate; here all crates are checked together,
with features, so that what lints with the same features checked of other crates is used again, and the program by itself as
well, with no more features than it asks for. The wheel of the Python package does so for the library.
Exits with 1 if a package is incomplete or larger than the registry accepts.
Usage: .ci/package.py [--no-verify] [--features FEATURES] (in the root of the workspace)
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys
import tarfile

# The registry refuses larger files.
MAX_BYTES = 10 * 1024 * 1024
METADATA = ("description", "keywords", "categories", "license", "readme", "repository", "rust_version")
FILES = ("Cargo.toml", "README.md", "LICENSE-MIT", "LICENSE-APACHE")


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--no-verify", action="store_true", help="compile nothing")
    parser.add_argument("--features", default="", help="of the crates that are checked together")
    arguments = parser.parse_args()

    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--no-deps"]
    metadata = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    # `publish = false` is an empty list of registries.
    published = [p for p in metadata["packages"] if p["publish"] != []]
    names = {package["name"] for package in published}
    findings = []
    for package in published:
        findings += [f"{package['name']}: no {key} in Cargo.toml" for key in METADATA if not package[key]]
        for dependency in package["dependencies"]:
            if "path" in dependency and dependency["kind"] != "dev" and dependency["name"] not in names:
                findings.append(f"{package['name']}: depends on {dependency['name']}, which is not published")
    if findings:
        print("\n".join(findings))
        return 1

    command = ["cargo", "package", "--workspace", "--locked", "--allow-dirty", "--no-verify"]
    for package in metadata["packages"]:
        if package["publish"] == []:
            command += ["--exclude", package["name"]]
    target = pathlib.Path(metadata["target_directory"])
    subprocess.run(command, check=True)
    if not arguments.no_verify:
        check_from_packages(metadata["packages"], target, arguments.features)

    folder = target / "package"
    for package in sorted(published, key=lambda package: package["name"]):
        stem = f"{package['name']}-{package['version']}"
        path = folder / f"{stem}.crate"
        size = path.stat().st_size
        with tarfile.open(path) as archive:
            held = {member.name for member in archive if member.isfile()}
        findings += [f"{package['name']}: no {file} in the package" for file in FILES if f"{stem}/{file}" not in held]
        note = ""
        if size > MAX_BYTES:
            note = f"  larger than {MAX_BYTES // 1024} KiB"
            findings.append(f"{package['name']}: {size // 1024} KiB{note}")
        print(f"{package['name']:24} {size // 1024:7} KiB{note}")
    print("\n".join(findings) if findings else f"{len(published)} packages are complete")
    return 1 if findings else 0


def check_from_packages(packages, target, features):
    """Compiles a copy of the workspace in which every published crate is its unpacked package."""
    root = target / "package" / "unpacked"
    shutil.rmtree(root, ignore_errors=True)
    (root / "crates").mkdir(parents=True)
    manifest = [pathlib.Path("Cargo.toml").read_text(), "[patch.crates-io]"]
    for package in packages:
        source = pathlib.Path(package["manifest_path"]).parent
        crate = root / "crates" / source.name
        if package["publish"] == []:
            shutil.copytree(source, crate)
            continue
        stem = f"{package['name']}-{package['version']}"
        with tarfile.open(target / "package" / f"{stem}.crate") as archive:
            archive.extractall(root, filter="data")
        (root / stem).rename(crate)
        manifest.append(f'{package["name"]} = {{ path = "crates/{source.name}" }}')
    (root / "Cargo.toml").write_text("\n".join(manifest) + "\n")
    shutil.copy("Cargo.lock", root)
    command = ["cargo", "check", "--release", "--offline", "--manifest-path", root / "Cargo.toml", "--target-dir", target]
    # With examples, whose dependencies give others their features as in the lints of all targets.
    subprocess.run([*command, "--workspace", "--lib", "--bins", "--examples", "--features", features], check=True)
    subprocess.run([*command, "-p", "grimnet-cli"], check=True)


if __name__ == "__main__":
    sys.exit(main())
