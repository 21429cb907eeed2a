"""A whole fleet: logs to outcomes on an engine, outcomes to the dataset and the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from monitor.fleet.dataset import Results, Tables, known_logs, merged, save
from monitor.fleet.engine import Died, Engine
from monitor.fleet.outcome import Outcome, Status, failed
from monitor.fleet.page import write_page
from monitor.fleet.places import Place
from monitor.fleet.sources import Source
from monitor.fleet.tables import AircraftRule
from monitor.fleet.task import Plan, Task, TooSlow, judge

__all__ = ["Account", "judge_all", "said"]


@dataclass(slots=True)
class Account:
    """What a run did, counted.

    Attributes
    ----------
    logs
        Named by the patterns.
    known
        Left as they were: judged before with the same settings and code, and not changed since.
    judged, unusable, failed
        Of those that were not known.
    faults
        Found in those that were not known.
    """

    logs: int = 0
    known: int = 0
    judged: int = 0
    unusable: int = 0
    failed: int = 0
    faults: int = 0

    @property
    def done(self) -> int:
        """Logs that need nothing more."""
        return self.known + self.judged + self.unusable + self.failed

    def note(self, outcome: Outcome) -> None:
        """Count one outcome."""
        self.judged += outcome["status"] == Status.JUDGED
        self.unusable += outcome["status"] == Status.UNUSABLE
        self.failed += outcome["status"] == Status.FAILED
        self.faults += len(outcome["faults"])


def judge_all(
    engine: Engine,
    sources: Sequence[Source],
    plan: Plan,
    old: Tables,
    aircraft: AircraftRule,
    *,
    retries: int = 2,
    tell: Callable[[Account], None] = lambda account: None,
) -> Account:
    """Judge every log that is not known; write the dataset and the page.

    Interrupted, it writes what it has and lets the interruption go on.

    Parameters
    ----------
    engine
        Whose workers do it.
    sources
        The logs.
    plan
        What is done with each.
    old
        The dataset that stands in the plan's folder.
    aircraft
        Tells whose log it is.
    retries
        How often a log that could not be read is tried again.
    tell
        Called as logs end, and now and then while none does.

    Raises
    ------
    EngineError
        The cluster is gone; what was judged until then is written.
    OSError
        The dataset or the page cannot be written.
    """
    known = {} if plan.again else known_logs(old, plan.key)
    todo = [s for s in sources if not s.stamp or known.get(s.log) != s.stamp]
    account = Account(logs=len(sources), known=len(sources) - len(todo))
    results = Results(aircraft)
    tell(account)
    tasks = (Task(source, plan) for source in todo)
    try:
        for ended in engine.run(judge, tasks, retries=retries, waiting=lambda: tell(account)):
            outcome = ended.result or failed(plan.key, said(ended.error))
            results.add(ended.item.source, outcome)
            account.note(outcome)
            tell(account)
    finally:
        place = Place(plan.out)
        tables = merged(old, results.tables())
        save(place, tables)
        write_page(place, tables, plan.key)
    return account


def said(error: BaseException | None) -> str:
    """Why a task failed, in one sentence."""
    if isinstance(error, Died):
        return "every worker that took it died: out of memory, or a crash"
    if isinstance(error, TooSlow):
        return str(error)
    if isinstance(error, OSError):
        return f"cannot read or write: {error.strerror or error}"
    kind, text = type(error).__name__, (str(error).splitlines() or [""])[0]
    return f"{kind}: {text}" if text else kind
