"""What the tests share: the program's demo and its answers.

GRIM is the program (default: `grim` on the path), GRIMNET_DEMO the folder of a demo that it made.
"""

import csv
import json
import os
import pathlib
import shutil
import subprocess

import grimnet
import pytest


@pytest.fixture(scope="session")
def grim():
    program = os.environ.get("GRIM") or shutil.which("grim")
    assert program, "set GRIM to the program to compare with, such as target/release/grim"
    return str(pathlib.Path(program).resolve())


@pytest.fixture(scope="session")
def demo(grim, tmp_path_factory):
    folder = os.environ.get("GRIMNET_DEMO")
    if folder:
        return pathlib.Path(folder).resolve()
    folder = tmp_path_factory.mktemp("demo") / "demo"
    subprocess.run([grim, "demo", "--photos", "4", "-o", folder], check=True, stdout=subprocess.DEVNULL)
    return folder


@pytest.fixture(scope="session")
def pack(demo):
    return demo / "area.grim"


@pytest.fixture(scope="session")
def photos(demo):
    found = sorted((demo / "photos").glob("*.jpg"))
    assert len(found) >= 4
    return found[:4]


@pytest.fixture(scope="session")
def truth(demo):
    with open(demo / "truth.csv", newline="") as file:
        return {row["photo"]: {name: float(row[name]) for name in row if name != "photo"} for row in csv.DictReader(file)}


@pytest.fixture(scope="session")
def localizer(pack):
    return grimnet.Localizer(pack)


@pytest.fixture(scope="session")
def json_lines(grim):
    """The JSON lines that the program prints."""

    def run(*arguments):
        done = subprocess.run([grim, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert done.returncode in (0, 1), done.stderr
        return [json.loads(line) for line in done.stdout.splitlines()]

    return run
