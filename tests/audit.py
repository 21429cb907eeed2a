"""The daemon's dependencies: licences, wheels for 64-bit Arm, known vulnerabilities.

``python -m tests.audit`` (``make audit``) prints every package that the daemon brings along, and
ends with 1 when one has a licence that ``tests/dependencies.toml`` does not have for it, has no
wheel for a companion computer, or is known to be vulnerable. The first needs no network; for the
others pip asks the package index, and pip-audit its database. What could not be asked is said.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

HERE = Path(__file__).resolve().parent
PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_28_aarch64")
"""What 64-bit Raspberry Pi OS, Ubuntu and Yocto images of the last years install."""


class Package(NamedTuple):
    """An installed package: name, version, the licence its metadata tells."""

    name: str
    version: str
    licence: str


def requirements() -> list[str]:
    """What pyproject.toml asks for, without extras."""
    content = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    asked: list[str] = content["project"]["dependencies"]
    return asked


def daemon_packages() -> list[Package]:
    """Every package that the daemon needs, and those that they need, as installed here."""
    found: dict[str, Package] = {}
    waiting = [Requirement(text) for text in requirements()]
    while waiting:
        asked = waiting.pop()
        name = canonicalize_name(asked.name)
        if name in found or (asked.marker is not None and not asked.marker.evaluate({"extra": ""})):
            continue
        try:
            here = distribution(name)
        except PackageNotFoundError:
            raise SystemExit(f"{name} is not installed: pip install -e .") from None
        found[name] = Package(name, here.version, licence(here.metadata))
        waiting += [Requirement(text) for text in here.requires or ()]
    return sorted(found.values())


def licence(metadata: object) -> str:
    """The licence by the metadata: the expression, else the field, else the classifiers."""
    get, every = metadata.get, metadata.get_all  # type: ignore[attr-defined]
    text = str(get("License-Expression") or "").strip()
    field = str(get("License") or "").strip()
    classifiers = [c for c in every("Classifier") or () if c.startswith("License ::")]
    return (
        text or field.partition("\n")[0] or "; ".join(c.rpartition(" :: ")[2] for c in classifiers)
    )


def accepted() -> dict[str, str]:
    """Package -> licence that was looked at and accepted."""
    table: dict[str, str] = tomllib.loads((HERE / "dependencies.toml").read_text(encoding="utf-8"))
    return table


def strange(packages: list[Package]) -> list[str]:
    """Packages with a licence that was not looked at, a sentence each."""
    known = accepted()
    return [
        f"{p.name} {p.version}: licence {p.licence!r}, accepted is {known.get(p.name)!r}"
        for p in packages
        if known.get(p.name) != p.licence
    ]


def without_wheel() -> str:
    """Why the daemon cannot be installed from wheels on 64-bit Arm; empty when it can."""
    with tempfile.TemporaryDirectory() as folder:
        platforms = [part for name in PLATFORMS for part in ("--platform", name)]
        command = [
            *(sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--no-input"),
            *("--ignore-installed", "--only-binary=:all:", "--implementation", "cp"),
            *("--python-version", "311", "--target", folder, *platforms, *requirements()),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["pip failed"])[-1]


def vulnerable(packages: list[Package]) -> tuple[list[str], int]:
    """Known vulnerabilities, a sentence each, and how many packages could be asked about."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "requirements.txt"
        file.write_text("".join(f"{p.name}=={p.version}\n" for p in packages))
        command = [
            *(sys.executable, "-m", "pip_audit", "--requirement", str(file), "--no-deps"),
            *("--disable-pip", "--format", "json", "--progress-spinner", "off"),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        answers = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        return [], 0
    asked = [a for a in answers if "vulns" in a]
    return [
        f"{a['name']} {a['version']}: {v['id']}, mended in {', '.join(v['fix_versions']) or 'none'}"
        for a in asked
        for v in a["vulns"]
    ], len(asked)


def main() -> int:
    """The command."""
    packages = daemon_packages()
    for p in packages:
        print(f"{p.name:<20} {p.version:<10} {p.licence}")
    wrong = strange(packages)
    if missing := without_wheel():
        wrong.append(f"not all wheels for 64-bit Arm: {missing}")
    else:
        print("every package has a wheel for 64-bit Arm or for any machine")
    known, asked = vulnerable(packages)
    wrong += known
    print(
        f"known vulnerabilities: {len(known)}, of {asked} of {len(packages)} packages asked about"
    )
    for sentence in wrong:
        print(sentence)
    return int(bool(wrong))


if __name__ == "__main__":
    raise SystemExit(main())
