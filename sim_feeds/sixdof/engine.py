"""One aircraft in JSBSim, in SI units, with the engine's traps closed.

- An initial velocity is kept as it was given: a latitude set after an airspeed changes the
  velocity, so does a heading set after a ground speed. :meth:`Engine.start` sets the velocity last.
- Its attitude integrator is Euler's, half a step late. Here attitude and rates use the schemes of
  second order, see ``INTEGRATORS``.
- ``p, q, r`` are rates against the earth's surface frame; gyros measure ``pi, qi, ri``.
- ``a-pilot`` is of the step before; specific force here is total force over mass.
- ``aero/qbar-area`` is not initialised, and functions outside an axis read the value of the step
  before: the same flight twice differs in its last digits. :meth:`Engine.start` clears it.
- Wind is the velocity the air moves toward.
- Some aircraft of JSBSim open network ports and write files: see :func:`_closed`.
- JSBSim prints to standard output; here it is silent.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from sim_feeds.wind import FOOT_M

if TYPE_CHECKING:
    import jsbsim

__all__ = [
    "FOOT_M",
    "POUND_N",
    "SLUG_KG",
    "AircraftMissing",
    "Engine",
    "EngineMissing",
    "Gauge",
    "Gauges",
    "bundled_aircraft",
]

Floats = NDArray[np.float64]

POUND_N: Final = 4.4482216152605
SLUG_KG: Final = POUND_N / FOOT_M
NEEDED: Final = (
    "the six-degree-of-freedom vehicle needs JSBSim: pip install 'mavsentry[sim]' "
    "(the kinematic vehicle flies without it)"
)
INTEGRATORS: Final = {
    "simulation/integrator/rate/rotational": 3.0,
    "simulation/integrator/rate/translational": 3.0,
    "simulation/integrator/position/rotational": 7.0,
    "simulation/integrator/position/translational": 4.0,
}
"""3 and 4 are Adams-Bashforth of second and third order, 7 is Buss' second-order rotation."""
TALKING: Final = ("input", "output")
"""Elements of an aircraft file that open ports or write files."""


class EngineMissing(RuntimeError):
    """JSBSim is not installed; the message says what to install."""


class AircraftMissing(ValueError):
    """No aircraft of this name; the message lists ours."""


def bundled_aircraft() -> Path:
    """Directory of our aircraft files."""
    return Path(str(files("sim_feeds.sixdof") / "aircraft"))


def _jsbsim() -> ModuleType:
    try:
        import jsbsim
    except ImportError:
        raise EngineMissing(NEEDED) from None
    return jsbsim


def _closed(root: Path, aircraft: str, scratch: Path) -> Path:
    """Directory with the aircraft, without what would open ports and write files.

    An aircraft file may name ports to be steered through and sockets or files to report to; some
    that JSBSim ships do. A simulator inside another program must not. Such an aircraft is copied
    to ``scratch`` with those elements left out.
    """
    source = root / aircraft / f"{aircraft}.xml"
    tree = ElementTree.parse(source)
    top = tree.getroot()
    talking = [child for child in top if child.tag in TALKING]
    if not talking:
        return root
    for child in talking:
        top.remove(child)
    shutil.copytree(source.parent, scratch / aircraft)
    tree.write(scratch / aircraft / source.name, encoding="utf-8", xml_declaration=True)
    return scratch


class Engine:
    """An aircraft and its equations of motion.

    Parameters
    ----------
    aircraft
        One of ours, or any that JSBSim ships ("c172p").
    dt_s
        Step of the integration.

    Raises
    ------
    EngineMissing
        JSBSim is not installed: show the message.
    AircraftMissing
        Neither we nor JSBSim have it.
    """

    def __init__(self, aircraft: str, *, dt_s: float) -> None:
        module = _jsbsim()
        module.FGJSBBase().debug_lvl = 0
        module.set_logger(module.DefaultLogger(module.LogLevel.FATAL))
        ours = bundled_aircraft()
        theirs = Path(module.get_default_root_dir())
        root = ours if (ours / aircraft).is_dir() else theirs / "aircraft"
        if not (root / aircraft / f"{aircraft}.xml").is_file():
            known = ", ".join(sorted(p.name for p in ours.iterdir() if p.is_dir()))
            raise AircraftMissing(f"no aircraft {aircraft!r}: ours are {known}; JSBSim has others")
        fdm: jsbsim.FGFDMExec = module.FGFDMExec(str(theirs))
        fdm.set_debug_level(0)
        with TemporaryDirectory() as scratch:
            root = _closed(root, aircraft, Path(scratch))
            loaded = fdm.load_model_with_paths(
                aircraft, str(root), str(theirs / "engine"), str(theirs / "systems")
            )
        if not loaded:
            raise AircraftMissing(f"JSBSim cannot read the aircraft {aircraft!r}")
        fdm.set_dt(dt_s)
        for name, scheme in INTEGRATORS.items():
            fdm[name] = scheme
        self.fdm = fdm
        self.aircraft = aircraft
        self.dt_s = dt_s
        self._properties = fdm.get_property_manager()
        # An aircraft whose thrust is its own equations has no engine that JSBSim knows.
        self._engines = fdm.get_propulsion().get_num_engines()
        levers = [f"[{i}]" for i in range(self._engines)] or [""]
        nodes = [self._properties.get_node(f"fcs/throttle-cmd-norm{lever}") for lever in levers]
        self._throttles = [node for node in nodes if node is not None]

    def node(self, name: str) -> Any:
        """The property of a name, for quick access.

        Raises
        ------
        KeyError
            This aircraft has no such property; JSBSim alone would make one that nothing reads.
        """
        node = self._properties.get_node(name)
        if node is None:
            raise KeyError(f"{self.aircraft} has no property {name}")
        return node

    def set(self, values: Mapping[str, float]) -> None:
        """Set properties by name."""
        for name, value in values.items():
            self.node(name).set_double_value(value)

    def start(
        self,
        *,
        lat_rad: float,
        lon_rad: float,
        height_m: float,
        euler_rad: tuple[float, float, float],
        vel_ned_m_s: Floats,
        wind_ned_m_s: Floats,
        field_m: float = 0.0,
    ) -> None:
        """Put the aircraft into the air.

        Parameters
        ----------
        lat_rad, lon_rad, height_m
            Geodetic, on the WGS84 ellipsoid.
        euler_rad
            Roll, pitch, yaw.
        vel_ned_m_s, wind_ned_m_s : (3,) float64
            Velocity against the ground, and steady wind.
        field_m
            Height of the ground.
        """
        roll, pitch, yaw = euler_rad
        self.set(
            {
                "ic/lat-geod-rad": lat_rad,
                "ic/long-gc-rad": lon_rad,
                "ic/terrain-elevation-ft": field_m / FOOT_M,
                "ic/h-sl-ft": height_m / FOOT_M,
                "ic/phi-rad": roll,
                "ic/theta-rad": pitch,
                "ic/psi-true-rad": yaw,
            }
        )
        self.fdm["aero/qbar-area"] = 0.0
        for axis, speed in zip("ned", vel_ned_m_s, strict=True):
            self.fdm[f"ic/v{axis}-fps"] = speed / FOOT_M
        self.fdm.run_ic()
        for axis, speed in zip(("north", "east", "down"), wind_ned_m_s, strict=True):
            self.fdm[f"atmosphere/wind-{axis}-fps"] = speed / FOOT_M

    def run_engines(self) -> None:
        """Engines running, mixture rich, propellers forward, gear up; in the air, after a start."""
        for i in range(self._engines):
            for lever in ("mixture", "advance"):
                self.fdm[f"fcs/{lever}-cmd-norm[{i}]"] = 1.0
        if self._engines:
            self.fdm["propulsion/set-running"] = -1.0
        self.fdm["gear/gear-cmd-norm"] = 0.0
        self.fdm["gear/gear-pos-norm"] = 0.0

    def set_throttle(self, command: float) -> None:
        """All throttles, 0 to 1; a glider has none."""
        for node in self._throttles:
            node.set_double_value(command)

    def step(self) -> None:
        """Advance by one step."""
        self.fdm.run()


@dataclass(frozen=True, slots=True)
class Gauge:
    """A property in our units: (its value - ``zero``) * ``scale``."""

    name: str
    property: str
    scale: float = 1.0
    zero: float = 0.0


class Gauges:
    """Properties of one engine that are read together.

    Parameters
    ----------
    engine
        Whose properties they are.
    gauges
        What to read, in order.
    """

    def __init__(self, engine: Engine, gauges: Sequence[Gauge]) -> None:
        self.names = [g.name for g in gauges]
        self._nodes = [(engine.node(g.property), g.scale, g.zero) for g in gauges]

    def read(self) -> list[float]:
        """Values now."""
        return [(node.get_double_value() - zero) * scale for node, scale, zero in self._nodes]
