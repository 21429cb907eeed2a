"""The audit of what the daemon needs; which packages those are today is its own business."""

from __future__ import annotations

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests import audit


def test_what_is_asked_for_directly_was_looked_at() -> None:
    asked = {canonicalize_name(Requirement(text).name) for text in audit.requirements()}
    assert asked <= set(audit.accepted())


def test_the_closure_of_what_is_asked_for_is_found() -> None:
    found = {package.name: package for package in audit.daemon_packages()}
    assert found.keys() >= {"numpy", "pydantic-core", "llvmlite"}  # of ours, and of theirs
    assert "pytest" not in found
    assert all(package.licence for package in found.values())


def test_a_package_or_licence_that_is_new_is_told() -> None:
    new = [audit.Package("numpy", "9.9", "Proprietary"), audit.Package("x", "1", "")]
    assert [sentence.partition(" ")[0] for sentence in audit.strange(new)] == ["numpy", "x"]
