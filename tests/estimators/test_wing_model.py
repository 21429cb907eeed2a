"""The prediction model of a damaged wing: hand cases, symmetry, filters, covariance, flags."""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimators.wing_faults import (
    Thresholds,
    flagged,
    lag_one,
    level_std,
    residual_covariance,
    second_moment,
)
from estimators.wing_model import AERODYNAMIC, POSITIVE, Airframe, inputs_of, predict_rows
from estimators.wing_residuals import WingResiduals, body_velocity, low_passed
from links.airframes import load_airframe

G0 = 9.80665


@pytest.fixture(scope="module")
def aerosonde():
    return Airframe.of(load_airframe("aerosonde"))


def level(n=1, *, tas=25.0, alpha=0.05, yaw=0.0, wind=(0.0, 0.0, 0.0), prop=500.0, **changes):
    """Inputs of straight and level flight at an angle of attack."""
    air = tas * np.array([math.cos(yaw), math.sin(yaw), 0.0])
    columns = {
        "euler_rad": np.tile([0.0, alpha, yaw], (n, 1)),
        "vel_ned_m_s": np.tile(air + np.asarray(wind), (n, 1)),
        "rate_rad_s": np.zeros((n, 3)),
        "surfaces_rad": np.zeros((n, 3)),
        "prop_rad_s": np.full(n, prop),
        "wind_ned_m_s": np.tile(wind, (n, 1)),
        "density_kg_m3": np.full(n, 1.2),
        "height_m": np.zeros(n),
    }
    return inputs_of(**{**columns, **changes})


def predicted(airframe, x, f=(0.0, 0.0, 0.0, 0.0)):
    phi = np.empty((len(x), 6))
    predict_rows(airframe.row(), x, np.tile(f, (len(x), 1)).astype(float), phi)
    return phi


class TestPrediction:
    def test_lift_drag_and_gravity_by_hand(self, aerosonde):
        V, alpha, a = 25.0, 0.05, aerosonde
        still = replace(a, CT0=0.0, CT1=0.0, CT2=0.0, CQ0=0.0, CQ1=0.0, CQ2=0.0)
        phi = predicted(still, level(tas=V, alpha=alpha))[0]
        force = 0.5 * 1.2 * V**2 * a.area_m2
        CL = a.CL0 + a.CLalpha * alpha
        CD = a.CDp + CL**2 / (math.pi * a.oswald * a.span_m**2 / a.area_m2)
        s, c = math.sin(alpha), math.cos(alpha)
        X, Z = force * (CL * s - CD * c), force * (-CL * c - CD * s)
        assert phi[0] == pytest.approx(X / a.mass_kg - G0 * s, rel=1e-6)
        assert phi[2] == pytest.approx(Z / a.mass_kg + G0 * c, rel=1e-6)
        pitch = force * a.chord_m * (a.Cm0 + a.Cmalpha * alpha)
        assert phi[4] == pytest.approx(pitch / a.Jy_kg_m2, rel=1e-9)
        np.testing.assert_allclose(phi[[1, 3, 5]], 0.0, atol=1e-12)

    def test_thrust_and_torque_by_hand(self, aerosonde):
        a, prop = aerosonde, 500.0
        off = replace(a, CT0=0.0, CT1=0.0, CT2=0.0, CQ0=0.0, CQ1=0.0, CQ2=0.0)
        gained = (predicted(a, level(prop=prop)) - predicted(off, level(prop=prop)))[0]
        n = prop / (2 * math.pi)
        J = 25.0 / (n * a.diameter_m)
        thrust = 1.2 * n**2 * a.diameter_m**4 * (a.CT0 + a.CT1 * J + a.CT2 * J**2)
        torque = 1.2 * n**2 * a.diameter_m**5 * (a.CQ0 + a.CQ1 * J + a.CQ2 * J**2)
        det = a.Jx_kg_m2 * a.Jz_kg_m2 - a.Jxz_kg_m2**2
        assert gained[0] == pytest.approx(thrust / a.mass_kg, rel=1e-9)
        assert gained[3] == pytest.approx(-torque * a.Jz_kg_m2 / det, rel=1e-9)

    def test_course_and_known_wind_change_nothing(self, aerosonde):
        """Body accelerations depend on the velocity through the air alone, without rotation."""
        still = predicted(aerosonde, level())
        moved = predicted(aerosonde, level(yaw=2.0, wind=(4.0, -3.0, 0.5)))
        np.testing.assert_allclose(moved, still, atol=1e-10)

    def test_rotating_body_sees_its_velocity_turn(self, aerosonde):
        x = level(rate_rad_s=np.array([[0.0, 0.0, 0.2]]))
        a = replace(aerosonde, CYbeta=0.0, Clr=0.0, Cnr=0.0)
        gained = predicted(a, x)[0] - predicted(a, level())[0]
        u = 25.0 * math.cos(0.05)
        assert gained[1] == pytest.approx(-0.2 * u, rel=1e-9)

    def test_measured_airspeed_replaces_the_wind_s(self, aerosonde):
        slow = predicted(aerosonde, level(tas=25.0, tas_m_s=np.array([20.0])))[0]
        lift = predicted(aerosonde, level(tas=25.0))[0][2] - G0 * math.cos(0.05)
        assert slow[2] - G0 * math.cos(0.05) == pytest.approx(lift * (20 / 25) ** 2, rel=2e-2)

    def test_lift_breaks_down_beyond_the_stall(self, aerosonde):
        lift = [-predicted(aerosonde, level(alpha=a))[0][2] for a in (0.2, 0.4, 0.6)]
        assert lift[1] > lift[0]
        assert lift[2] < lift[1]


class TestFaults:
    def test_right_lift_loss_rolls_right_and_sinks(self, aerosonde):
        """10 % of half the lift at a quarter of the span."""
        a = aerosonde
        change = predicted(a, level(), (10.0, 0, 0, 0))[0] - predicted(a, level())[0]
        force = 0.5 * 1.2 * 25.0**2 * a.area_m2
        lost = 0.1 * 0.5 * force * (a.CL0 + a.CLalpha * 0.05)
        assert change[2] == pytest.approx(lost * math.cos(0.05) / a.mass_kg, rel=1e-6)
        moment = lost * math.cos(0.05) * a.span_m / 4
        det = a.Jx_kg_m2 * a.Jz_kg_m2 - a.Jxz_kg_m2**2
        yaw = lost * math.sin(0.05) * a.span_m / 4
        expected = (a.Jz_kg_m2 * moment + a.Jxz_kg_m2 * yaw) / det
        assert change[3] == pytest.approx(expected, rel=1e-6)

    def test_right_drag_yaws_right_and_slows(self, aerosonde):
        change = predicted(aerosonde, level(), (0, 10.0, 0, 0)) - predicted(aerosonde, level())
        assert change[0, 0] < 0.0
        assert change[0, 5] > 0.0

    def test_wings_are_mirror_images(self, aerosonde):
        a = replace(aerosonde, CQ0=0.0, CQ1=0.0, CQ2=0.0)
        mirror = np.array([1, -1, 1, -1, 1, -1])
        none = predicted(a, level())
        for right, left in (((7.0, 0, 0, 0), (0, 0, 7.0, 0)), ((0, 7.0, 0, 0), (0, 0, 0, 7.0))):
            np.testing.assert_allclose(
                predicted(a, level(), right) - none,
                mirror * (predicted(a, level(), left) - none),
                atol=1e-12,
            )


class TestAirframe:
    def test_missing_number_is_named(self):
        numbers = load_airframe("aerosonde")
        del numbers["Clda"]
        with pytest.raises(ValueError, match="lacks Clda"):
            Airframe.of(numbers)

    def test_unknown_and_infinite_numbers_are_named(self):
        numbers = load_airframe("aerosonde")
        with pytest.raises(ValueError, match="no use for Clx"):
            Airframe.of({**numbers, "Clx": 1.0})
        with pytest.raises(ValueError, match=r"not finite.*CL0"):
            Airframe.of({**numbers, "CL0": math.nan})

    @pytest.mark.parametrize("key", POSITIVE)
    @pytest.mark.parametrize("value", [0.0, -1.0])
    def test_what_must_be_above_zero_is_named(self, key, value):
        with pytest.raises(ValueError, match=f"not above zero in the airframe: {key}$"):
            Airframe.of(load_airframe("aerosonde") | {key: value})

    def test_a_product_of_inertia_that_no_body_has_is_named(self):
        with pytest.raises(ValueError, match="Jxz_kg_m2 is too large"):
            Airframe.of(load_airframe("aerosonde") | {"Jxz_kg_m2": -1.3})

    def test_the_kernel_reads_the_row_that_the_fields_make(self, aerosonde):
        """Every aerodynamic number changes some acceleration in a general state."""
        x = level(
            rate_rad_s=np.array([[0.3, 0.2, 0.1]]),
            surfaces_rad=np.array([[0.1, 0.05, 0.08]]),
            wind_ned_m_s=np.array([[0.0, 3.0, 0.0]]),
        )
        base = predicted(aerosonde, x)
        for name in AERODYNAMIC:
            other = replace(aerosonde, **{name: getattr(aerosonde, name) + 0.01})
            assert np.abs(predicted(other, x) - base).max() > 1e-6, name


class TestResiduals:
    def test_body_velocity_turns_with_attitude(self):
        x = level(yaw=0.7, euler_rad=np.array([[0.3, 0.1, 0.7]]))[0]
        v = np.empty(6)
        body_velocity(x, v)
        assert np.linalg.norm(v[:3]) == pytest.approx(25.0)
        x[0:3] = 0.0, 0.0, 0.7
        body_velocity(x, v)
        np.testing.assert_allclose(v[:3], [25.0, 0.0, 0.0], atol=1e-12)

    def test_low_pass_follows_a_step_with_its_time_constant(self):
        t = np.arange(0.0, 30.0, 0.05)
        u = np.where(t > 0.0, 1.0, 0.0)[:, None]
        out = np.empty_like(u)
        low_passed(t, u, 10.0, out)
        np.testing.assert_allclose(out[:, 0], 1.0 - np.exp(-t / 10.0), atol=1e-12)

    def test_a_motion_that_obeys_the_model_leaves_nothing(self, aerosonde):
        """Free flight integrated here, small steps: residuals vanish; with a fault they are S f."""
        for fault in ((0.0, 0, 0, 0), (4.0, 0, 0, 10.0)):
            t, x = _flown(aerosonde, fault)
            at, y, S = WingResiduals(aerosonde).run(t, x)
            late = at > 2.0
            expected = S[late] @ np.array(fault)
            np.testing.assert_allclose(y[late], expected, atol=2e-3)
            if any(fault):
                assert np.abs(y[late, 3]).max() > 0.1

    def test_rows_come_at_an_even_pace_whatever_the_split(self, aerosonde):
        t, x = _flown(aerosonde, (2.0, 0, 0, 0))
        at, y, S = WingResiduals(aerosonde).run(t, x)
        np.testing.assert_allclose(np.diff(at), 0.5, atol=1e-9)
        stream = WingResiduals(aerosonde)
        parts = [stream.run(t[k : k + 7], x[k : k + 7]) for k in range(0, len(t), 7)]
        np.testing.assert_array_equal(np.concatenate([p[0] for p in parts]), at)
        np.testing.assert_array_equal(np.concatenate([p[1] for p in parts]), y)
        np.testing.assert_array_equal(np.concatenate([p[2] for p in parts]), S)

    def test_rows_without_a_number_and_gaps_do_no_harm(self, aerosonde):
        t, x = _flown(aerosonde, (0.0, 0, 0, 0))
        x[100, 3] = np.nan
        t[50] = t[49]
        keep = np.ones(len(t), bool)
        keep[150:200] = False
        _, y, _ = WingResiduals(aerosonde).run(t[keep], x[keep])
        assert np.abs(y).max() < 5e-3


def _flown(airframe, fault, dt=0.01, seconds=5.0):
    """Body motion of the model itself (RK4, Euler angles), still air, controls fixed."""
    n = round(seconds / dt) + 1
    x = level(n, alpha=0.045, prop=505.0)
    x[:, 9] = -0.11
    row, f = airframe.row(), np.array([fault], float)

    def rates(s):
        one = x[:1].copy()
        roll, pitch, yaw = s[6:9]
        one[0, 0:3] = s[6:9]
        C = _body_from_ned(roll, pitch, yaw)
        one[0, 3:6] = C.T @ s[0:3]
        one[0, 6:9] = s[3:6]
        phi = np.empty((1, 6))
        predict_rows(row, one, f, phi)
        p, q, r = s[3:6]
        turn = [
            p + math.tan(pitch) * (q * math.sin(roll) + r * math.cos(roll)),
            q * math.cos(roll) - r * math.sin(roll),
            (q * math.sin(roll) + r * math.cos(roll)) / math.cos(pitch),
        ]
        return np.concatenate([phi[0], turn])

    s = np.array([25.0 * math.cos(0.045), 0.0, 25.0 * math.sin(0.045), 0, 0, 0, 0, 0.045, 0.3])
    for k in range(n):
        x[k, 0:3] = s[6:9]
        x[k, 3:6] = _body_from_ned(*s[6:9]).T @ s[0:3]
        x[k, 6:9] = s[3:6]
        a = rates(s)
        b = rates(s + 0.5 * dt * a)
        c = rates(s + 0.5 * dt * b)
        d = rates(s + dt * c)
        s = s + dt / 6.0 * (a + 2 * b + 2 * c + d)
    return dt * np.arange(n), x


def _body_from_ned(roll, pitch, yaw):
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cp * cy, cp * sy, -sp],
            [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
            [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
        ]
    )


class TestCovarianceAndFlags:
    def test_second_moment_counts_a_constant_error(self):
        y = np.tile([1.0, 2.0, 0, 0, 0, 0], (10, 1))
        assert second_moment(y)[0, 1] == pytest.approx(2.0)
        assert residual_covariance(y, 0.1)[1, 1] == pytest.approx(4.4)

    def test_lag_one_of_a_first_order_sequence(self):
        rng = np.random.default_rng(1)
        y = np.zeros((20000, 6))
        for k in range(1, len(y)):
            y[k] = 0.8 * y[k - 1] + rng.normal(size=6)
        np.testing.assert_allclose(lag_one(y), 0.8, atol=0.02)

    @pytest.mark.parametrize("correlation", [0.0, 0.9])
    def test_level_std_is_that_of_repeated_trials(self, correlation):
        rng = np.random.default_rng(2)
        N, S = 20, rng.normal(size=(20, 6, 4))
        noise = np.diag([1.0, 2.0, 0.5, 1.0, 3.0, 1.0])
        Q = np.eye(6)
        A = S.reshape(-1, 4)
        gain = np.linalg.pinv(A)
        e = np.zeros((4000, N, 6))
        fresh = rng.normal(size=e.shape) * np.sqrt(np.diag(noise))
        e[:, 0] = fresh[:, 0]
        for k in range(1, N):
            e[:, k] = correlation * e[:, k - 1] + math.sqrt(1 - correlation**2) * fresh[:, k]
        trials = e.reshape(4000, -1) @ gain.T
        np.testing.assert_allclose(
            level_std(S, Q, noise, correlation), trials.std(axis=0), rtol=0.06
        )

    def test_flags_on_size_and_on_difference(self):
        t = Thresholds(lift=8.0, drag=20.0, lift_apart=3.0, drag_apart=5.0, leak=0.5)
        cases = {
            (9.0, 0.0, 7.0, 0.0): [1, 0, 0, 0],
            (4.0, 0.0, 0.5, 0.0): [1, 0, 0, 0],
            (2.0, 6.5, 1.0, 0.5): [0, 1, 0, 0],
            (7.0, 19.0, 7.0, 19.0): [0, 0, 0, 0],
            (2.0, 6.5, 0.0, 1.0): [0, 0, 0, 0],
        }
        found = flagged(np.array(list(cases)), t)
        np.testing.assert_array_equal(found, np.array(list(cases.values()), bool))
