#!/usr/bin/env python3
"""The night's joint fit as one would write it with numpy and scipy.optimize.least_squares.

Reads what fit_export.cpp wrote; the formulas are those of estimator/inference/scene.h and frame_cost.cpp: the same
residuals, the same parameters, tolerances as Ceres has them there. Derivatives are scipy's finite differences. Prints
lines "name value": the best ln sigma and its cost, the cost of the parameters that lampglow found, evaluations of the
model, and the processor time of the search and of the profile of ln sigma. Loading and what depends on the reference
alone are not on the clock, as they are not in lampglow.

    scipy_fit.py FOLDER | --check       (--check: exit code 77 if there is no scipy)
"""
import json
import pathlib
import sys
import time

try:
    import numpy as np
    from scipy.optimize import least_squares
except ImportError as missing:
    print(missing, file=sys.stderr)
    sys.exit(77)

LN_SIGMA, Q, LN_GAIN, LN_KAPPA, EMISSION, SLOPE_X, SLOPE_Y, COMMON = range(8)
MOR_TIMES_EXTINCTION = 2.996
ROOF_DISTANCE_M = 400
CORE_TAIL, SKY_SIGMA, WIDE_GAIN_SIGMA = 8, 30, 3  # frame_cost.cpp
STARTS = 3  # fewer than lampglow's five


def soften(r, tail):
    """sign(r) sqrt(rho(r^2)) with Cauchy's rho."""
    return np.sign(r) * tail * np.sqrt(np.log1p((r / tail) ** 2))


def cubic_weights(t):
    """Catmull-Rom's, of the four neighbours of a point at t in 0..1 between the middle two."""
    return np.stack([-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2], -1) / 2


class Glow:
    """T^2 g(T, q) at the scene's nodes, of the table; beyond its ends powers of T, as scene_light.cpp has them."""

    def __init__(self, ln_thickness, minus_ln_1_q, ln_glow):
        self.x0, self.dx = ln_thickness[0], ln_thickness[1] - ln_thickness[0]
        self.y0, self.dy = minus_ln_1_q[0], minus_ln_1_q[1] - minus_ln_1_q[0]
        self.last = ln_thickness[-1]
        ln_glow = ln_glow + 2 * ln_thickness[:, None, None]
        self.slope_at_end = np.minimum(np.gradient(ln_glow[-4:], self.dx, axis=0, edge_order=2)[-1], -2)
        # One more row beyond each end, in a straight line.
        ln_glow = np.concatenate([2 * ln_glow[:1] - ln_glow[1:2], ln_glow, 2 * ln_glow[-1:] - ln_glow[-2:-1]])
        self.ln_glow = np.concatenate(
            [2 * ln_glow[:, :1] - ln_glow[:, 1:2], ln_glow, 2 * ln_glow[:, -1:] - ln_glow[:, -2:-1]], 1)

    def __call__(self, thickness, q):
        ln_thickness = np.log(thickness)
        x = (np.clip(ln_thickness, self.x0, self.last) - self.x0) / self.dx
        y = (-np.log1p(-q) - self.y0) / self.dy
        i = np.minimum(x.astype(int), self.ln_glow.shape[0] - 4)
        k = min(int(y), self.ln_glow.shape[1] - 4)
        near = self.ln_glow[:, k:k + 4][i[:, None] + np.arange(4)]
        by_q = cubic_weights(np.float64(y - k))
        ln_glow = np.einsum("ja,jabn,b->jn", cubic_weights(x - i), near, by_q, optimize=False)
        below = np.minimum(ln_thickness - self.x0, 0)
        above = np.maximum(ln_thickness - self.last, 0)
        slope = self.slope_at_end[k] if above.any() else 0
        return np.exp(ln_glow + below[:, None] + above[:, None] * slope)


class Problem:
    def __init__(self, folder):
        array = {file.stem: np.load(file) for file in folder.glob("*.npy")}
        self.o = json.loads((folder / "problem.json").read_text())
        self.lamp = {name: array[name] for name in (
            "solid_angle_sr", "distance_m", "distance_ln_sigma", "ln_strength", "ln_strength_sigma", "ln_halo",
            "ln_halo_sigma", "core_seen", "guest", "ln_beam", "ln_beam_sigma", "lit")}
        self.lamps = len(self.lamp["lit"])
        used = array["ring_used"] != 0
        self.value, self.sigma = array["ring_value"][used], array["ring_sigma"][used]
        self.own = array["ring_lamp"][used].astype(int)
        self.x, self.y = array["ring_x"][used], array["ring_y"][used]
        self.lens, self.sky = 1 + array["pattern_lens"][used], array["pattern_sky"][used]
        core = array["ring_core"][used] != 0
        self.tail = np.where(core, CORE_TAIL, self.o["ring_tail"]) if self.o["gain_known"] else self.o["ring_tail"]
        self.direct = array["direct"][used] * self.lens[:, None] * self.lamp["lit"]
        self.by_kappa = core[:, None] & (self.own[:, None] == np.arange(self.lamps)) & (self.lamp["core_seen"] == 0)
        # The lens spreads the halo and the ring averages it: one matrix.
        halo = np.einsum("rjm,nm->rjn", array["average"][used], array["convolution"], optimize=True)
        self.halo = (halo * self.lamp["lit"][:, None]).reshape(len(self.value), -1)
        theta_deg = np.degrees(array["node_theta_rad"])
        self.shape = np.clip(np.log(theta_deg) / np.log(4), 0, 1.5)
        self.glow = Glow(array["glow_ln_thickness"], array["glow_minus_ln_1_q"], array["glow_ln"])
        self.our_parameters = array["our_parameters"]
        self.our_profile = array["our_profile_ln_sigma"]
        self.evaluations = 0

    def parts(self, p):
        strength, halo, distance, sky = p[COMMON:].reshape(4, self.lamps)
        return strength, halo, distance, sky

    def light(self, p):
        lamp = self.lamp
        ln_strength, ln_halo, ln_distance, _ = self.parts(p)
        kappa = np.exp(p[LN_KAPPA])
        strength = np.exp(p[LN_GAIN] + lamp["ln_strength"] + ln_strength)
        thickness = np.exp(p[LN_SIGMA] + ln_distance) * lamp["distance_m"]
        beam = strength * np.exp(-thickness)
        scale = strength * np.where(lamp["core_seen"], 1, kappa) * np.exp(
            lamp["ln_halo"] * (1 - p[Q]) / 0.13 + ln_halo)
        scale = scale * 4 * np.pi * lamp["solid_angle_sr"]
        halo = scale[:, None] * self.glow(thickness, p[Q]) * (1 + p[EMISSION] * self.shape)
        direct = self.direct
        if self.by_kappa.any():
            direct = direct * np.where(self.by_kappa, kappa, 1)
        return direct @ beam + self.halo @ halo.ravel()

    def model(self, p):
        self.evaluations += 1
        sky = self.parts(p)[3][self.own] + p[SLOPE_X] * self.x + p[SLOPE_Y] * self.y
        return self.light(p) + self.sky_factor(p) * self.o["sky_unit"] * sky

    def sky_factor(self, p):
        return 1 + self.sky * np.exp(-np.exp(p[LN_SIGMA]) * ROOF_DISTANCE_M)

    def prior_q(self, ln_sigma):
        o = self.o
        x = (np.log(MOR_TIMES_EXTINCTION) - ln_sigma - np.log(300)) / np.log(100)
        clearness = 1 / (1 + np.exp(-6 * (x - 0.5)))
        beyond = max(0, clearness - 0.6) / 0.4
        mean = o["q_mean_fog"] + (o["q_mean_haze"] - o["q_mean_fog"]) * clearness
        mean += (o["q_mean_clear"] - o["q_mean_haze"]) * beyond
        return mean, o["q_sigma"] + (o["q_sigma_clear"] - o["q_sigma"]) * beyond

    def priors(self, p):
        o, lamp = self.o, self.lamp
        strength, halo, distance, sky = self.parts(p)
        mean, sigma = self.prior_q(p[LN_SIGMA])
        known = o["gain_known"]
        gain = p[LN_GAIN] / (o["ln_gain_sigma"] if known else WIDE_GAIN_SIGMA)
        kappa_sigma = o["kappa_sigma"] if o["kappa_sigma"] > 0 else o["core_ln_sigma"]
        by = lambda value, sigma: np.divide(value, sigma, out=np.zeros_like(value), where=sigma > 0)
        ln_beam = p[LN_GAIN] + lamp["ln_strength"] + strength
        ln_beam = ln_beam - np.exp(p[LN_SIGMA] + distance) * lamp["distance_m"]
        return np.concatenate([
            [(p[Q] - mean) / sigma, soften(gain, o["prior_tail"]) if known else gain,
             p[LN_KAPPA] / kappa_sigma if kappa_sigma > 0 else 0, (p[EMISSION] - o["emission_mean"]) / o["emission_sigma"],
             p[SLOPE_X] / o["slope_sigma"], p[SLOPE_Y] / o["slope_sigma"]],
            soften(by(strength, lamp["ln_strength_sigma"]), o["prior_tail"]), by(halo, lamp["ln_halo_sigma"]),
            by(distance, lamp["distance_ln_sigma"]), (sky - 1) / SKY_SIGMA,
            by(ln_beam - lamp["ln_beam"], lamp["ln_beam_sigma"] * lamp["guest"])])

    def residuals(self, p):
        return np.concatenate([soften((self.model(p) - self.value) / self.sigma, self.tail), self.priors(p)])

    def cost(self, p):
        return np.sum(self.residuals(p) ** 2) / 2

    def free(self):
        lamp, o = self.lamp, self.o
        free = np.ones(COMMON + 4 * self.lamps, bool)
        free[LN_KAPPA] = o["kappa_sigma"] > 0 or o["core_ln_sigma"] > 0
        by_lamp = [lamp["lit"] * lamp[s] > 0 for s in ("ln_strength_sigma", "ln_halo_sigma", "distance_ln_sigma")]
        free[COMMON:COMMON + 3 * self.lamps] = np.concatenate(by_lamp)
        return free

    def solve(self, start, hold_sigma=False, most_evaluations=40):
        free, o = self.free(), self.o
        free[LN_SIGMA] = not hold_sigma
        low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
        low[LN_SIGMA], high[LN_SIGMA] = o["ln_sigma_low"], o["ln_sigma_high"]
        low[Q], high[Q] = 0, o["max_q"]
        p = np.clip(start, low, high)

        def residuals(x):
            p[free] = x
            return self.residuals(p)

        solved = least_squares(residuals, p[free], bounds=(low[free], high[free]), x_scale="jac", ftol=1e-6, xtol=1e-7,
                               gtol=1e-10, max_nfev=most_evaluations)
        p[free] = solved.x
        return solved.cost, p.copy()

    def start_at(self, mor_m):
        p = np.zeros(COMMON + 4 * self.lamps)
        p[LN_SIGMA] = np.log(MOR_TIMES_EXTINCTION / mor_m)
        p[Q] = min(self.prior_q(p[LN_SIGMA])[0], self.o["max_q"])
        p[EMISSION] = self.o["emission_mean"]
        weight, factor = 1 / self.sigma**2, self.sky_factor(p)
        above = np.bincount(self.own, weight * factor * (self.value - self.light(p)), self.lamps)
        whole = np.bincount(self.own, weight * factor**2, self.lamps)
        p[COMMON + 3 * self.lamps:] = np.where(
            whole > 0, np.maximum(above, 0) / np.where(whole > 0, whole, 1) / self.o["sky_unit"], 1)
        return self.cost(p), p

    def search(self):
        scan = sorted((self.start_at(mor) for mor in 35 * 1.5 ** np.arange(19)), key=lambda start: start[0])
        starts = []
        for _, p in scan:
            if len(starts) < STARTS and all(abs(p[LN_SIGMA] - other[LN_SIGMA]) >= 0.6 for other in starts):
                starts.append(p)
        return min((self.solve(start) for start in starts), key=lambda solved: solved[0])

    def profile(self, best):
        """Everything else fitted at the ln sigma where lampglow has its own profile, from the best outwards."""
        costs = []
        for side in (-1, 1):
            p = best
            for ln_sigma in sorted(self.our_profile[side * (self.our_profile - best[LN_SIGMA]) > 1e-3], key=lambda x: side * x):
                p = p.copy()
                p[LN_SIGMA] = ln_sigma
                cost, p = self.solve(p, hold_sigma=True, most_evaluations=6)
                costs.append(cost)
        return costs


def main():
    if sys.argv[1] == "--check":
        return
    problem = Problem(pathlib.Path(sys.argv[1]))
    print("our_cost", problem.o["our_cost"])
    print("cost_at_ours", problem.cost(problem.our_parameters))
    problem.evaluations = 0
    begin = time.process_time()
    cost, best = problem.search()
    searched = time.process_time()
    problem.profile(best)
    end = time.process_time()
    print("ln_sigma", best[LN_SIGMA])
    print("cost", cost)
    print("evaluations", problem.evaluations)
    print("search_s", searched - begin)
    print("cpu_s", end - begin)


if __name__ == "__main__":
    main()
