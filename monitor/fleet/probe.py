"""What a worker is asked before it gets work: which mavsentry it runs, what it sees."""

from __future__ import annotations

import uuid

from monitor.fleet.engine import Engine, EngineError
from monitor.fleet.places import Place
from monitor.fleet.task import code_version

__all__ = ["answer", "check_workers"]


def check_workers(engine: Engine, out: str) -> None:
    """Look whether every worker runs this mavsentry and sees the folder of the results.

    Raises
    ------
    EngineError
        One does not.
    OSError
        The folder cannot be written.
    """
    place, mark = Place(out), f".seen-{uuid.uuid4().hex[:12]}"
    place.write(mark, b"")
    try:
        answers = engine.everywhere(answer, out, mark)
    except (ImportError, AttributeError) as error:
        raise EngineError(f"a worker cannot run this mavsentry: {error}") from None
    finally:
        place.remove(mark)
    for worker, (version, sees) in answers.items():
        if version != code_version():
            raise EngineError(
                f"the worker {worker} runs mavsentry {version}, this is {code_version()}: "
                "install the same on all computers"
            )
        if not sees:
            raise EngineError(
                f"the worker {worker} does not see {out}: the results of a cluster go to a "
                "folder that all its computers share, or to a URL such as s3://bucket/fleet"
            )


def answer(out: str, mark: str) -> tuple[str, bool]:
    """Asked on a worker: its version, and whether it sees a file in the results' folder."""
    return code_version(), Place(out).read(mark) is not None
