"""Reception, signers and kept signing times, as the settings ask for them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, MutableMapping, Sequence
from pathlib import Path

from links.mavlink.reception import Reception, ReceptionOptions
from links.mavlink.signing import Signer, SigningClock, Verifier
from monitor.security.key import find_key
from monitor.security.timestamps import SigningTimes, TimestampKeeper, TimestampStore
from monitor.settings import Settings

__all__ = ["Gate", "open_gate"]


class Gate:
    """What stands between the links and the loop.

    Parameters
    ----------
    reception
        Lets frames in.
    signers
        One for each link; none where nothing is signed.
    keeper
        Of signing times; None without a key.
    notes
        What an operator must know from the start.

    Attributes
    ----------
    reception
        As given.
    """

    def __init__(
        self,
        reception: Reception,
        signers: Sequence[Signer] = (),
        keeper: TimestampKeeper | None = None,
        notes: Iterable[str] = (),
    ) -> None:
        self.reception = reception
        self._signers = tuple(signers)
        self._keeper = keeper
        self._notes = tuple(notes)

    @property
    def signs(self) -> bool:
        """Whether what is sent is signed."""
        return bool(self._signers)

    @property
    def notes(self) -> tuple[str, ...]:
        """What an operator must know now, a sentence each."""
        trouble = self._keeper.trouble if self._keeper is not None else ""
        return (*self._notes, trouble) if trouble else self._notes

    def sign(self, frame: bytes, link: int) -> bytes:
        """A MAVLink 2 frame as it goes out on a link."""
        return self._signers[link].sign(frame) if self._signers else frame

    def tend(self, now_us: int) -> None:
        """What time makes due, in every turn of the loop; never waits."""
        if self._keeper is not None:
            self._keeper.tend(now_us)

    def close(self) -> None:
        """Keep the last signing times."""
        if self._keeper is not None:
            self._keeper.close()

    def __enter__(self) -> Gate:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_gate(
    settings: Settings,
    links: Sequence[str],
    environ: MutableMapping[str, str],
    state_folder: Path,
    *,
    inputs: Collection[int] | None = None,
    wants: Iterable[str] = (),
) -> Gate:
    """The gate that the settings ask for.

    Parameters
    ----------
    links
        Names of all links by number, as ``Hub.names``.
    environ
        The environment; a key in it is taken out of it.
    state_folder
        Where signing times are kept.
    inputs
        Numbers of links that the vehicle is listened to on; None: all.
    wants
        Names of the messages that services want.

    Raises
    ------
    KeyFileError
        There is a key and it cannot be used.
    ValueError
        Unknown dialect, or an unsigned link that is none of the links.
    """
    here, dialect = settings.security, settings.links.dialect
    if strange := sorted(set(here.unsigned_links) - set(links)):
        raise ValueError(
            f"security.unsigned_links names {strange[0]}, which is none of the links: "
            + ", ".join(links)
        )
    options = ReceptionOptions(
        dialect=dialect,
        allow=here.allow,
        accept_unsigned=here.accept_unsigned,
        unsigned_links=frozenset(k for k, name in enumerate(links) if name in here.unsigned_links),
        inputs=None if inputs is None else frozenset(inputs),
    )
    key = find_key(here.key_file, environ)
    if key is None:
        return Gate(Reception(options, links, wants=wants))
    store = TimestampStore(state_folder / f"signing-{settings.links.component_id}.json")
    notes, times = [], SigningTimes()
    try:
        times = store.load()
    except OSError as error:
        notes.append(f"cannot read {store.path}: {error.strerror}")
    except ValueError as error:
        notes.append(str(error))
    clock = SigningClock(times.time)
    verifier = Verifier(key, clock, times.streams.items())
    signers = [Signer(key, clock, k, dialect) for k in range(len(links))] if here.sign else []
    keeper = TimestampKeeper(store, clock, verifier)
    return Gate(Reception(options, links, verifier, wants), signers, keeper, notes)
