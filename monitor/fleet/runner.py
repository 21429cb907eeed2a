"""A whole fleet: logs to outcomes on an engine, outcomes to the dataset and the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import pyarrow as pa
import pyarrow.compute as pc

from monitor.fleet.dataset import Results, Tables, merged, save, unknown
from monitor.fleet.engine import Died, Engine
from monitor.fleet.outcome import failed
from monitor.fleet.page import write_page
from monitor.fleet.places import Place
from monitor.fleet.sources import Source
from monitor.fleet.tables import AircraftRule
from monitor.fleet.task import Plan, Task, judge

__all__ = ["Account", "judge_all", "left"]


@dataclass(slots=True)
class Account:
    """What a run did, counted over all logs that it was given.

    Attributes
    ----------
    logs
        Given.
    known
        Left as they were: judged before with the same settings and code, and not changed since.
    by_status
        What became of the others while the run goes on, of all logs at its end: status -> logs.
    reasons
        Why logs were not judged: reason -> logs.
    faulty, faults
        Logs with a fault, and faults in all of them.
    """

    logs: int = 0
    known: int = 0
    by_status: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    faulty: int = 0
    faults: int = 0

    @property
    def done(self) -> int:
        """Logs that this run need not look at any more."""
        return self.known + sum(self.by_status.values())

    def note(self, status: str, reason: str, faults: int) -> None:
        """Count one log."""
        self.by_status[status] += 1
        if reason:
            self.reasons[reason] += 1
        self.faulty += faults > 0
        self.faults += faults


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
    todo = left(sources, plan, old)
    account = Account(logs=len(sources), known=len(sources) - len(todo))
    results = Results(aircraft)
    tell(account)
    ends = engine.run(judge, _tasks(todo, plan), retries=retries, waiting=lambda: tell(account))
    try:
        for ended in ends:
            outcome = ended.result or failed(plan.key, _said(ended.error))
            results.add(ended.item.source, outcome)
            account.note(outcome["status"], outcome["reason"], len(outcome["faults"]))
            tell(account)
    finally:
        place, tables = Place(plan.out), merged(old, results.tables())
        save(place, tables)
        write_page(place, tables, plan.key)
    return _final(account, sources, tables)


def left(sources: Sequence[Source], plan: Plan, old: Tables) -> list[Source]:
    """The logs that are not known: parameters as of :func:`judge_all`."""
    return list(sources) if plan.again else unknown(old, plan.key, sources)


def _tasks(todo: Sequence[Source], plan: Plan) -> Iterator[Task]:
    sizes = Counter(source.bytes for source in todo)
    for source in todo:
        yield Task(source, plan, twin=sizes[source.bytes] > 1)


def _final(account: Account, sources: Sequence[Source], tables: Tables) -> Account:
    """The account of all logs that were given, known ones and copies told apart."""
    logs = tables["logs"]
    logs = logs.filter(pc.is_in(logs["log"], value_set=pa.array([s.shown for s in sources])))
    final = Account(account.logs, account.known)
    columns = (logs[column].to_pylist() for column in ("status", "reason", "faults"))
    for status, reason, faults in zip(*columns, strict=True):
        final.note(status, reason, faults)
    return final


def _said(error: BaseException | None) -> str:
    """Why a task failed, in one sentence."""
    if isinstance(error, Died):
        return "every worker that took it died: out of memory, or a crash"
    if isinstance(error, OSError):
        return f"cannot read or write: {error.strerror or error}"
    kind, text = type(error).__name__, (str(error).splitlines() or [""])[0]
    return f"{kind}: {text}" if text else kind
