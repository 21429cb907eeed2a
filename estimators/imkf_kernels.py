"""Intermittent-measurement Kalman filter: prediction, conditional corrections, merging, as kernels.

Symbols and equations stand in :mod:`estimators.imkf`.

R is diagonal, so a correction with several channels is one scalar correction after the other, and
the 2^m hypotheses are the leaves of a binary tree: channel i splits every hypothesis about the
channels before it into "i is faulty" (nothing happens) and "i works" (one scalar correction). All
conditional corrections of (8) with their likelihoods (11) cost 2^m - 1 scalar corrections, and no
matrix is ever inverted. The channels are taken last to first: then a faulty branch stays where it
is, the working ones follow as a block, and the leaves end up in the order of their numbers j, with
channel 1 the most significant bit of (6).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "HELD",
    "IMPOSSIBLE",
    "MISSING",
    "OK",
    "REJECTED",
    "Memory",
    "Model",
    "Out",
    "Rules",
    "run",
]

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

OK, MISSING, HELD, REJECTED, IMPOSSIBLE = range(5)

LN_2PI = math.log(2.0 * math.pi)
UNDERFLOW = -746.0
"""Below it an exponential is zero."""


class Model(NamedTuple):
    """Constants of the linear system and of its channels; see :mod:`estimators.imkf`."""

    A: Array
    B: Array
    C: Array
    Q: Array
    r: Array
    ln_range: Array


class Rules(NamedTuple):
    """What is done with the hypotheses; see :class:`estimators.imkf.Settings`."""

    first: int
    delta: float
    keep: bool
    tau: float
    floor: float
    ceiling: float


class Memory(NamedTuple):
    """What lasts from one sample to the next (x, P, h, u), and scratch of fixed size.

    x, P : (n,), (n, n)
        Estimate and covariance.
    h : (m,)
        Probability that a channel works, before its output is seen.
    u : (r,)
        The last finite input.
    xm, Pm, g : (n,), (n, n), (n,)
        Prediction; P c.
    xj, Pj, lnj, xi : (2^m, n), (2^m, n, n), (2^m,), (2^m,)
        Conditional corrections, logarithm of prior times likelihood, weights.
    """

    x: Array
    P: Array
    h: Array
    u: Array
    xm: Array
    Pm: Array
    g: Array
    xj: Array
    Pj: Array
    lnj: Array
    xi: Array


class Out(NamedTuple):
    """One row per sample; `xi` may have no rows, then the weights are not kept."""

    x: Array
    P: Array
    w: Array
    h: Array
    ln_evidence: Array
    none: Array
    status: Bytes
    xi: Array


@kernel
def ln(p: float) -> float:
    """Logarithm of a probability; of none at all, minus infinity."""
    return math.log(p) if p > 0.0 else -math.inf


@kernel
def predict(model: Model, s: Memory) -> None:
    """Xm, Pm from x, P and the input held in s.u, eq. (4)."""
    A, B = model.A, model.B
    n = A.shape[0]
    for i in range(n):
        moved = 0.0
        for j in range(n):
            moved += A[i, j] * s.x[j]
        for j in range(B.shape[1]):
            moved += B[i, j] * s.u[j]
        s.xm[i] = moved
    for i in range(n):
        for j in range(n):
            total = 0.0
            for a in range(n):
                total += A[i, a] * s.P[a, j]
            s.g[j] = total
        for j in range(i + 1):
            total = model.Q[i, j]
            for a in range(n):
                total += s.g[a] * A[j, a]
            s.Pm[i, j] = total
            s.Pm[j, i] = total


@kernel
def condition(model: Model, rules: Rules, s: Memory, y: Array) -> int:
    """Conditional corrections and ln (prior times likelihood) of all hypotheses, (7)-(13).

    A channel that is not finite splits the hypotheses without correcting anything: it tells
    nothing. Returns how many channels told something.
    """
    C, g, xj, Pj, lnj = model.C, s.g, s.xj, s.Pj, s.lnj
    n, m = C.shape[1], C.shape[0]
    for a in range(n):
        xj[0, a] = s.xm[a]
        for b in range(a + 1):
            Pj[0, a, b] = s.Pm[a, b]
    lnj[0] = 0.0
    leaves = 1
    seen = 0
    for i in range(m - 1, -1, -1):
        works = s.h[i]
        if rules.tau > 0.0:
            works = min(max(works, rules.floor), rules.ceiling)
        ln_works, ln_fails = ln(works), ln(1.0 - works)
        present = math.isfinite(y[i])
        if present:
            ln_works -= 0.5 * LN_2PI
            ln_fails -= model.ln_range[i]
            seen += 1
        for j in range(leaves):
            child = leaves + j
            if present:
                nu, S = y[i], model.r[i]
                for a in range(n):
                    total = 0.0
                    for b in range(n):
                        total += C[i, b] * (Pj[j, a, b] if a >= b else Pj[j, b, a])
                    g[a] = total
                    nu -= C[i, a] * xj[j, a]
                    S += C[i, a] * total
                inverse = 1.0 / S
                scaled = nu * inverse
                for a in range(n):
                    xj[child, a] = xj[j, a] + g[a] * scaled
                    gain = g[a] * inverse
                    for b in range(a + 1):
                        Pj[child, a, b] = Pj[j, a, b] - gain * g[b]
                lnj[child] = lnj[j] + ln_works - 0.5 * (math.log(S) + nu * scaled)
            else:
                for a in range(n):
                    xj[child, a] = xj[j, a]
                    for b in range(a + 1):
                        Pj[child, a, b] = Pj[j, a, b]
                lnj[child] = lnj[j] + ln_works
            lnj[j] += ln_fails
        leaves *= 2
    return seen


@kernel
def merge(rules: Rules, s: Memory) -> float:
    """Weights (14), then s.x, s.P as the mixture's mean and covariance, (15)-(18).

    Returns the logarithm of (14)'s denominator; not finite when no hypothesis is possible, and
    then the prediction becomes the estimate.
    """
    x, P, xj, Pj, lnj, xi = s.x, s.P, s.xj, s.Pj, s.lnj, s.xi
    n, leaves = x.shape[0], lnj.shape[0]
    top = -math.inf
    for j in range(rules.first, leaves):
        if lnj[j] > top:
            top = lnj[j]
    possible = math.isfinite(top)
    for a in range(n):
        x[a] = 0.0 if possible else s.xm[a]
        for b in range(n):
            P[a, b] = 0.0 if possible else s.Pm[a, b]
    den = 0.0
    for j in range(leaves):
        likely = possible and j >= rules.first and lnj[j] - top > UNDERFLOW
        xi[j] = math.exp(lnj[j] - top) if likely else 0.0
        den += xi[j]
    if not possible:
        return top
    inverse = 1.0 / den
    for j in range(leaves):
        xi[j] *= inverse
        if xi[j] > 0.0:
            for a in range(n):
                x[a] += xi[j] * xj[j, a]
    for j in range(leaves):
        if xi[j] > 0.0:
            for a in range(n):
                apart = xj[j, a] - x[a]
                for b in range(a + 1):
                    P[a, b] += xi[j] * (Pj[j, a, b] + apart * (xj[j, b] - x[b]))
    for a in range(n):
        for b in range(a):
            P[b, a] = P[a, b]
    return top + math.log(den)


@kernel
def run(model: Model, rules: Rules, s: Memory, u: Array, y: Array, out: Out) -> None:
    """Algorithm 1 over the rows of u and y: ``u[k]`` leads to the sample at which ``y[k]`` is."""
    n, m = model.A.shape[0], model.C.shape[0]
    leaves = s.lnj.shape[0]
    for k in range(y.shape[0]):
        status = OK
        for i in range(u.shape[1]):
            if math.isfinite(u[k, i]):
                s.u[i] = u[k, i]
            else:
                status = HELD
        predict(model, s)
        if condition(model, rules, s, y[k]) == 0:
            status = max(status, MISSING)
        # out holds x, P of k - 1 until it is known whether they stay
        for a in range(n):
            out.x[k, a] = s.x[a]
            for b in range(n):
                out.P[k, a, b] = s.P[a, b]
        ln_evidence = merge(rules, s)
        if not math.isfinite(ln_evidence):
            status = IMPOSSIBLE
        jump = 0.0
        for a in range(n):
            jump += (s.x[a] - out.x[k, a]) ** 2
        if status != IMPOSSIBLE and jump > rules.delta * rules.delta:
            status = REJECTED
            for a in range(n):
                s.x[a] = out.x[k, a] if rules.keep else s.xm[a]
                for b in range(n):
                    s.P[a, b] = out.P[k, a, b] if rules.keep else s.Pm[a, b]
        for a in range(n):
            out.x[k, a] = s.x[a]
            for b in range(n):
                out.P[k, a, b] = s.P[a, b]
        for i in range(m):
            bit = 1 << (m - 1 - i)
            w = 0.0
            for j in range(leaves):
                if j & bit:
                    w += s.xi[j]
            if status == IMPOSSIBLE:
                w = s.h[i]
            out.w[k, i] = w
            if rules.tau > 0.0 and math.isfinite(y[k, i]):
                s.h[i] += (w - s.h[i]) / rules.tau
            out.h[k, i] = s.h[i]
        out.ln_evidence[k] = ln_evidence
        out.none[k] = s.xi[0]
        out.status[k] = status
        if out.xi.shape[0]:
            for j in range(leaves):
                out.xi[k, j] = s.xi[j]
