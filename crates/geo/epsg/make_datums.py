"""Writes datums.txt: the names and codes of datums, and the EPSG code whose definition has the ellipsoid and the shift of each.

    python make_datums.py ~/.cargo/registry/src/*/crs-definitions-*/src/defs.rs            # needs pyproj

A line has the code of a geographic system counted from Greenwich, and of its datum the EPSG code and the names: those of the EPSG registry, its aliases (ESRI's
among them, without `D_`), and those of GDAL in the list of crs-definitions. Left out are datums for which the lists of definitions have no
shift, or one of zero, or grids only, and names that two datums with different definitions have.
"""

import re
import sqlite3
import sys
from collections import defaultdict
from pathlib import Path

import pyproj

DATUM = ("+datum=", "+ellps=", "+towgs84=", "+a=", "+b=", "+rf=", "+nadgrids=")
# The codes that epsg_definitions.rs refuses: MGI (Ferro) is one datum in Austria, and another one in the former Yugoslavia.
REFUSED = {4805}
# The codes to which epsg_definitions.rs gives the shift that the list lacks: IG05 and IG05/12.
CORRECTED = {6983, 6990}

HERE = Path(__file__).parent


def definitions(listed):
    """PROJ strings of all codes, and the datums' names of the list."""
    rows = re.findall(r'^\s*EPSG_(\d+)\|\d+\|"([^"]*)"\|r#"(.*?)"#', Path(listed).read_text(), re.M)
    added = re.findall(r"^(\d+) (.*)$", (HERE / "definitions.txt").read_text(), re.M)
    strings = {int(code): proj for code, proj in added} | {int(code): proj for code, proj, _ in rows}
    names = {int(code): re.findall(r'DATUM\["([^"]*)"', wkt) for code, _, wkt in rows}
    return strings, names


def datum_of(proj):
    return tuple(part for part in proj.split() if part.startswith(DATUM))


def has_shift(proj):
    shift = re.search(r"\+towgs84=(\S+)", proj)
    # NAD 27 is a grid.
    named = "+datum=" in proj and "+datum=NAD27" not in proj
    return named or shift is not None and any(float(number) for number in shift[1].split(","))


def key(name):
    """As datum_names.rs compares them."""
    return re.sub(r"[^a-z0-9+]", "", re.sub(r"^D_", "", name, flags=re.I).lower())


def main(listed):
    strings, listed_names = definitions(listed)
    db = sqlite3.connect(Path(pyproj.datadir.get_data_dir()) / "proj.db")
    systems = db.execute(
        "SELECT crs.code, crs.name, datum.code, datum.name, datum.prime_meridian_code, datum.deprecated FROM geodetic_crs crs "
        "JOIN geodetic_datum datum ON crs.datum_auth_name = datum.auth_name AND crs.datum_code = datum.code "
        "WHERE crs.auth_name = 'EPSG' AND datum.auth_name = 'EPSG' AND crs.type = 'geographic 2D' "
        "ORDER BY crs.deprecated, crs.code"
    ).fetchall()
    aliases = defaultdict(list)
    for code, name in db.execute(
        "SELECT code, alt_name FROM alias_name WHERE table_name = 'geodetic_datum' AND auth_name = 'EPSG' ORDER BY source, alt_name"
    ):
        aliases[code].append(name)
    by_name = {name: int(code) for code, name, *_ in reversed(systems)}
    codes = {}  # of a datum
    users = defaultdict(dict)  # of a name: codes, and whether their datums are deprecated
    spelling = {}
    for code, name, datum, datum_name, meridian, deprecated in systems:
        if code in REFUSED:
            continue
        # "NTF (Paris)" is NTF with longitudes from Paris, and the text says from where.
        base = int(code) if meridian == 8901 else by_name.get(name.rsplit(" (", 1)[0])
        base = codes.setdefault(datum, base)
        if base is None or not (base in CORRECTED or has_shift(strings.get(base, ""))):
            continue
        for named in [str(datum), datum_name, *aliases[datum], *listed_names.get(int(code), [])]:
            if named.isascii():
                spelling.setdefault(key(named), re.sub(r"[^\w+]+", "_", re.sub("^D_", "", named)).strip("_"))
                users[key(named)].setdefault(base, deprecated)
    names = defaultdict(list)
    for named, bases in users.items():
        current = [base for base, deprecated in bases.items() if not deprecated] or list(bases)
        if len({datum_of(strings[base]) for base in current}) > 1:
            print("left out:", spelling[named], current)
            continue
        names[current[0]].append(spelling[named])
    rows = [f"{code} {' '.join(named)}" for code, named in sorted(names.items())]
    (version,) = db.execute("SELECT value FROM metadata WHERE key = 'EPSG.VERSION'").fetchone()
    head = f"# EPSG registry {version}, PROJ {pyproj.proj_version_str}"
    (HERE / "datums.txt").write_text("\n".join([head, *rows]) + "\n")
    print(len(rows), "datums,", sum(map(len, names.values())), "names")


main(sys.argv[1])
