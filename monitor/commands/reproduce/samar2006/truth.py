"""The flights that the estimator is judged on: possible ones, in von Karman's air, on their path.

Another engine flies them, so that truth and prediction model share no equation. What that engine
says must still be true: specific force, gravity and the earth's rotation, integrated with gravity
and frames of our own, have to give its velocity, its gyro rates its attitude.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.study import Claim, Figure, Job, Result, Results, Scope, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from sim_feeds.sixdof import SixDofFlight
    from sim_feeds.sixdof.aerosonde import Wing

__all__ = ["blocks", "claims", "jobs", "work"]

Floats = NDArray[np.float64]

AIR: Final = {
    "calm": ("calm", 0.0, 0.0),
    "steady": ("steady wind, 22 % of airspeed", 0.22, 0.0),
    "turbulent": ("wind 20 %, turbulence", 0.20, 1.0),
    "strong": ("wind 25 %, turbulence", 0.25, 1.0),
    "damaged": ("wind 25 %, turbulence, both wings damaged", 0.25, 1.0),
}
"""Its words, steady wind as a share of the airspeed, factor on the turbulence that goes with it."""
DAMAGE: Final[tuple[tuple[Wing, float], ...]] = (("right.lift", 10.0), ("left.drag", 20.0))
FULL_S: Final = 300.0
QUICK_S: Final = 60.0
QUICK: Final = ("strong", "damaged")
BOUND_M_S2: Final = 2e-3
"""On the velocity gained in a second, root mean square."""
PATH_BOUND_M: Final = 50.0
"""95 % of the flight nearer to the path than two seconds' flight: "performs fairly well"."""
SPECTRUM_BOUND: Final = 0.10
SCATTERS: Final = 4.0
"""A band's power may miss the spectrum by this share and this many standard deviations of what a
short flight meets; low-order filters lose half of it in the last bands."""
SEGMENT: Final = 8192
BANDS: Final = np.geomspace(5.0, 1500.0, 12)
"""Edges of omega L / V."""
JUDGED: Final = slice(5, None)
"""Bands with waves enough in a minute to be judged."""
INDEPENDENT: Final = 0.5
"""Share of periodogram ordinates that count, with Hann's window and half-overlapping segments."""

SEED: Final = 100


def jobs(scope: Scope) -> list[Job]:
    """One flight in each air."""
    seconds = QUICK_S if scope.quick else FULL_S
    return [
        Job("samar2006", f"truth/{air}", {"air": air, "seconds": seconds}, scope.drawn(SEED))
        for air in (QUICK if scope.quick else AIR)
    ]


def work(job: Job) -> Result:
    """Fly with a row at each step of the integration, and examine it."""
    from sim_feeds.sixdof import WingFault, consistency, fly_aerosonde
    from sim_feeds.sixdof.aerosonde import CRUISE_M_S, HEIGHT_M, STEP_S

    air, seconds = job.what["air"], job.what["seconds"]
    _, wind, turbulence = AIR[air]
    damage = [WingFault(which, seconds / 3.0, size) for which, size in DAMAGE]
    flight = fly_aerosonde(
        damage if air == "damaged" else (),
        seed=job.seed,
        wind_share=wind,
        duration_s=seconds,
        turbulence=turbulence,
        record_s=STEP_S,
    )
    found = consistency(flight)
    out: Result = {
        "velocity_m_s2": found.velocity_m_s2,
        "attitude_rad_s": found.attitude_rad_s,
        "height_m": float(np.abs(flight.height_m - HEIGHT_M).max()),
        "tas_m_s": float(np.abs(flight.tas_m_s - CRUISE_M_S).max()),
        "beside_m": float(np.quantile(_beside(flight), 0.95)),
    }
    if air == "strong":
        out |= _spectrum(flight)
    return out


def _beside(flight: SixDofFlight) -> Floats:
    """Distance from the nearest leg."""
    from sim_feeds.sixdof.aerosonde import WAYPOINTS_M

    corners = np.array([*WAYPOINTS_M, WAYPOINTS_M[0]])
    leg = np.diff(corners, axis=0)
    length = np.linalg.norm(leg, axis=1)
    along = leg / length[:, None]
    offset = flight.ned_m[::20, None, :2] - corners[:-1]
    ahead = np.clip(np.sum(offset * along, axis=2), 0.0, length)
    miss = np.linalg.norm(offset - ahead[:, :, None] * along, axis=2)
    return np.asarray(miss.min(axis=1))


def _spectrum(flight: SixDofFlight) -> Result:
    """Power of the gusts that were met in bands of omega L / V, measured and von Karman's."""
    from sim_feeds.sixdof.aerosonde import CRUISE_M_S, HEIGHT_M
    from sim_feeds.von_karman import VonKarman, exact_density

    wind = float(np.linalg.norm(flight.mean_wind_ned_m_s))
    gust = flight.wind_ned_m_s - flight.mean_wind_ned_m_s
    c, s = np.cos(flight.euler_rad[:, 2]), np.sin(flight.euler_rad[:, 2])
    path = np.stack([c * gust[:, 0] + s * gust[:, 1], c * gust[:, 1] - s * gust[:, 0], gust[:, 2]])
    (std,), (scale,) = VonKarman(wind_6m_m_s=wind).scales(np.array([HEIGHT_M]))
    window = np.hanning(SEGMENT)
    starts = range(0, path.shape[1] - SEGMENT + 1, SEGMENT // 2)
    omega = 2.0 * np.pi * np.fft.rfftfreq(SEGMENT, flight.dt_s)
    met, model, scatter = [], [], []
    for axis in range(3):
        pieces = np.array([path[axis, a : a + SEGMENT] for a in starts])
        power = np.abs(np.fft.rfft(window * pieces, axis=1)) ** 2
        density = power.mean(axis=0) * flight.dt_s / (np.pi * np.sum(window**2))
        T = scale[axis] / CRUISE_M_S
        x = omega * T
        exact = std[axis] ** 2 * T * exact_density(x, lateral=axis > 0)
        bands = [(x >= a) & (x < b) for a, b in pairwise(BANDS)]
        met.append([density[band].mean() / (std[axis] ** 2 * T) for band in bands])
        model.append([exact[band].mean() / (std[axis] ** 2 * T) for band in bands])
        waves = INDEPENDENT * len(starts) * np.array([np.count_nonzero(band) for band in bands])
        scatter.append(1.0 / np.sqrt(waves))
    return {"met": np.array(met), "model": np.array(model), "scatter": np.array(scatter)}


def _own(results: Results) -> list[tuple[str, Any]]:
    return [(air, results[f"truth/{air}"]) for air in AIR if f"truth/{air}" in results]


def blocks(results: Results, scope: Scope) -> list[Table | Figure]:
    """How true the flights are, and the turbulence that they met; nothing where none was flown."""
    own = _own(results)
    rows = [
        [
            AIR[air][0],
            float(np.max(r["velocity_m_s2"])),
            BOUND_M_S2,
            float(np.max(r["attitude_rad_s"])),
            r["height_m"],
            r["tas_m_s"],
            r["beside_m"],
        ]
        for air, r in own
    ]
    if not rows:
        return []
    table = Table(
        "samar2006-truth",
        "The flights against their own sensors: velocity gained in one second minus specific force,"
        " gravity and the earth's rotation integrated; attitude minus gyro rates integrated; root"
        " mean square of the worst axis. Beside it how well the autopilot held its path.",
        [
            "air",
            "velocity [m/s² rms]",
            "bound [m/s² rms]",
            "attitude [rad/s rms]",
            "height within [m]",
            "airspeed within [m/s]",
            "beside the path, 95 % [m]",
        ],
        rows,
    )
    strong = results.get("truth/strong")
    if strong is None:
        return [table]

    def draw(canvas: Canvas) -> None:
        x = np.sqrt(BANDS[:-1] * BANDS[1:])
        axes = canvas.subplots(1, 3, sharey=True)
        for ax, title, met, model in zip(
            axes, ("ahead", "right", "down"), strong["met"], strong["model"], strict=True
        ):
            ax.loglog(x, model, color="0.5", label="von Kármán")
            ax.loglog(x, met, "o", color="C0", markersize=3, label="met in flight")
            ax.set_title(title)
            ax.set_xlabel("ω L / V")
        axes[0].set_ylabel("power density / (σ² L / V)")
        axes[0].legend()

    return [
        table,
        Figure(
            "samar2006-spectrum",
            "Turbulence as the aircraft met it, along its path, against the spectra of"
            " MIL-F-8785C.",
            draw,
            (8.0, 2.8),
        ),
    ]


def claims(results: Results, scope: Scope) -> list[Claim]:
    """Section IV: path and turbulence of the simulation."""
    own = _own(results)
    if not own:
        return []
    beside = max(r["beside_m"] for air, r in own if AIR[air][1] > 0.0)
    out = [
        Claim(
            "Fig. 3: the controller follows the waypoints in strong wind",
            "holds" if beside < PATH_BOUND_M else "does not hold",
            f"95 % of the flight is within {beside:.0f} m of the straight legs, rounded corners"
            " counted, in winds of 20 to 25 % of the airspeed and with damaged wings. Our"
            " controller is a simple one, the paper's a model-predictive one.",
        )
    ]
    strong = results.get("truth/strong")
    if strong is not None:
        miss = np.abs(np.asarray(strong["met"]) / np.asarray(strong["model"]) - 1.0)[:, JUDGED]
        scatter = np.asarray(strong["scatter"])[:, JUDGED]
        holds = bool((miss < SPECTRUM_BOUND + SCATTERS * scatter).all())
        out.append(
            Claim(
                "Section IV: turbulence of von Kármán's spectrum through shaping filters",
                "holds" if holds else "does not hold",
                f"In bands of ω L / V from {BANDS[JUDGED][0]:.0f} to {BANDS[-1]:.0f} the power met"
                f" in flight is within {100.0 * miss.max():.0f} % of the exact spectrum; the"
                f" scatter of a band of this length is {100.0 * scatter.max():.0f} % at most.",
            )
        )
    return out
