"""What a worker is asked before it gets work: which mavsentry it runs, what it sees."""

from __future__ import annotations

import uuid

from monitor.fleet.engine import Engine, EngineError
from monitor.fleet.places import Place
from monitor.fleet.task import code_version

__all__ = ["check_same_code", "check_workers", "sees"]


def check_workers(engine: Engine, out: str) -> None:
    """Look whether every worker runs this mavsentry and sees the folder of the results.

    Raises
    ------
    EngineError
        One does not.
    OSError
        The folder cannot be written.
    """
    check_same_code(engine)
    place, mark = Place(out), f".seen-{uuid.uuid4().hex[:12]}"
    place.write(mark, b"")
    try:
        seen = engine.everywhere(sees, out, mark)
    finally:
        place.remove(mark)
    blind = next((worker for worker, its_own in seen.items() if not its_own), None)
    if blind is not None:
        raise EngineError(
            f"the worker {blind} does not see {out}: the results of a cluster go to a "
            "folder that all its computers share, or to a URL such as s3://bucket/fleet"
        )


def check_same_code(engine: Engine) -> None:
    """Look whether every worker runs this mavsentry: results of another would not compare.

    Raises
    ------
    EngineError
        One does not.
    """
    try:
        versions = engine.everywhere(code_version)
    except (ImportError, AttributeError) as error:
        raise EngineError(f"a worker cannot run this mavsentry: {error}") from None
    for worker, version in versions.items():
        if version != code_version():
            raise EngineError(
                f"the worker {worker} runs mavsentry {version}, this is {code_version()}: "
                "install the same on all computers"
            )


def sees(out: str, mark: str) -> bool:
    """Asked on a worker: whether it sees a file in the results' folder."""
    return Place(out).read(mark) is not None
