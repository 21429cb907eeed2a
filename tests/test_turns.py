"""A test that must be alone is; the others share the machine."""

import fcntl
import os
import threading
import time

from tests.turns import locked, turn


class Workers:
    """Threads that each hold the machine once; who was in at the same time."""

    def __init__(self, place):
        self.place, self.inside, self.met, self.order = place, set(), [], []
        self.threads = []

    def start(self, name, *, alone, gate=None):
        thread = threading.Thread(target=self._work, args=(name, alone, gate))
        self.threads.append(thread)
        thread.start()
        time.sleep(0.05)

    def _work(self, name, alone, gate):
        with turn(self.place, alone=alone):
            self.inside.add(name)
            self.order.append(name)
            self.met.append(frozenset(self.inside))
            if gate is not None:
                gate.wait(10.0)
            self.inside.discard(name)

    def join(self):
        for thread in self.threads:
            thread.join(10.0)
            assert not thread.is_alive()


def test_those_who_share_work_together(tmp_path):
    workers, gate = Workers(tmp_path / "x"), threading.Event()
    for name in "ab":
        workers.start(name, alone=False, gate=gate)
    gate.set()
    workers.join()
    assert frozenset("ab") in workers.met


def test_who_is_alone_meets_nobody_and_is_not_passed_over(tmp_path):
    workers, gate = Workers(tmp_path / "x"), threading.Event()
    workers.start("first", alone=False, gate=gate)
    workers.start("alone", alone=True)
    workers.start("late", alone=False)
    assert workers.order == ["first"]
    gate.set()
    workers.join()
    assert workers.order == ["first", "alone", "late"]
    assert frozenset({"alone"}) in workers.met
    assert not any("alone" in met and len(met) > 1 for met in workers.met)


def test_a_copy_that_was_left_open_holds_nothing(tmp_path):
    name = str(tmp_path / "x")
    with locked(name) as descriptor:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        copy = os.dup(descriptor)  # as a process has that was forked here and lives on
    with locked(name) as descriptor:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(copy)
