#!/usr/bin/env python3
"""How well lampglow measures: simulated nights through the real program, scored against their truth.

Each row is one kind of night. `lampglow simulate` makes the archives (halos are counted photons, all nuisances on),
`lampglow replay --json` estimates, and this script scores the records itself. Beside the achieved error stands the
Cramér-Rao bound of the same frames. A row below its floor fails the run (exit code 1); floors are what was measured
less the scatter of so few frames, and `goal` is what the project wants.

    tests/bench/accuracy/accuracy.py --binary build/release/daemon/lampglow                 # quick, for CI
    tests/bench/accuracy/accuracy.py --binary ... --frames 45 --seeds 3 --photons 1000000   # thorough, takes long
    tests/bench/accuracy/accuracy.py --binary ... --row "webcam, 7 lamps" --keep /tmp/bench
"""
import argparse
import csv
import json
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

# range: the visibilities, m, whose share within the limits counts; frames: at least so many a night, where ten are too few to
# tell.
ROWS = [
    {"name": "bracket, 7 lamps", "simulate": [], "range": (0, 8000), "goal": 0.95},
    {"name": "bracket, 1 lamp", "simulate": ["--lamps", "1"], "range": (0, 8000)},
    {"name": "bracket, 3 lamps", "simulate": ["--lamps", "3"], "range": (0, 8000)},
    {"name": "bracket, 20 lamps", "simulate": ["--lamps", "20"], "range": (0, 8000)},
    {"name": "webcam, 7 lamps", "simulate": ["--style", "webcam"], "range": (0, 5000), "goal": 0.80, "frames": 20},
    {"name": "webcam, 1 lamp", "simulate": ["--style", "webcam", "--lamps", "1"], "range": (0, 5000)},
    {"name": "webcam, 3 lamps", "simulate": ["--style", "webcam", "--lamps", "3"], "range": (0, 5000), "frames": 20},
    {"name": "webcam, 20 lamps", "simulate": ["--style", "webcam", "--lamps", "20"], "range": (0, 5000)},
    {"name": "one known lamp, 180 m", "range": (150, 1500), "tolerance": 0.20, "goal": 0.80,
     "simulate": ["--distances", "60,100,180,300,500,800,1200", "--catalogue", "L3", "--mor-min", "100",
                  "--mor-max", "1500"]},
    {"name": "cut-off, 7 lamps", "range": (80, 3000), "goal": 0.85,
     "simulate": ["--luminaire", "cutoff", "--mor-min", "80", "--mor-max", "3000"]},
    {"name": "day, 4 targets", "simulate": ["--day"], "range": (50, 8000), "goal": 0.90},
    {"name": "APSF series, 1 lamp", "simulate": ["--lamps", "1"], "range": (0, 8000), "same_nights_as": "bracket, 1 lamp",
     "replay": ["--model", "apsf_series"]},
]

# Least values (greatest for fog_wrong and worst_factor); absent: no floor. They hold for the quick settings, whose
# archives are always the same, and guard against steps back; the goals are the project's.
FLOORS = {
    "bracket, 7 lamps": {"wmo_share": 0.9, "coverage": 0.9, "worst_factor": 1.5, "fog_wrong": 0, "weather_share": 0.85},
    "bracket, 1 lamp": {"fog_wrong": 0},
    "bracket, 3 lamps": {"wmo_share": 0.75, "coverage": 0.85, "worst_factor": 1.5, "fog_wrong": 0, "weather_share": 0.85},
    "bracket, 20 lamps": {"wmo_share": 0.85, "coverage": 0.85, "worst_factor": 1.5, "fog_wrong": 0, "weather_share": 0.85},
    "webcam, 7 lamps": {"wmo_share": 0.85, "coverage": 0.85, "worst_factor": 1.5, "fog_wrong": 0, "weather_share": 0.85},
    "webcam, 1 lamp": {"fog_wrong": 0},
    "webcam, 3 lamps": {"wmo_share": 0.65, "coverage": 0.85, "fog_wrong": 0, "weather_share": 0.6},
    "webcam, 20 lamps": {"wmo_share": 0.4, "fog_wrong": 0, "weather_share": 0.8},
    "one known lamp, 180 m": {"wmo_share": 0.7, "coverage": 0.85, "worst_factor": 1.5, "fog_wrong": 1},
    "cut-off, 7 lamps": {"wmo_share": 0.85, "coverage": 0.85, "worst_factor": 1.3, "fog_wrong": 0},
}


def wmo_allowed_m(truth_m):
    """Required uncertainty of MOR (WMO-No. 8, ICAO Annex 3)."""
    if truth_m <= 600:
        return 50.0
    return (0.10 if truth_m <= 1500 else 0.20) * truth_m


def run(command):
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if result.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: exit code {result.returncode}\n{result.stderr.strip()}")
    return result.stdout


def supports(binary, command, option):
    return option in subprocess.run([binary, command, "--help"], stdout=subprocess.PIPE, text=True).stdout


def score_pairs(pairs, row):
    """pairs: (record, truth) of every observation; everything the table shows."""
    low, high = row["range"]
    s = {"frames": len(pairs), "in_range": 0, "within": 0, "values": 0, "limits": 0, "limits_right": 0, "beyond": 0,
         "beyond_right": 0, "covered": 0, "bounded": 0, "fog_wrong": 0, "fog_decided": 0, "weather": 0,
         "weather_right": 0, "thick": 0, "thick_guessed": 0, "errors": [], "bounds": [], "ratios": [], "worst": 0.0}
    for record, truth in pairs:
        true_m = float(truth["mor_m"])
        estimate, limit = record["mor_m"], record["limit"]
        is_value = estimate is not None and not limit
        is_limit = estimate is not None and bool(limit)
        limit_right = is_limit and (true_m >= estimate if limit == "above" else true_m <= estimate)
        s["values"] += is_value
        s["limits"] += is_limit
        s["limits_right"] += limit_right
        if low <= true_m <= high:
            s["in_range"] += 1
            allowed = row["tolerance"] * true_m if "tolerance" in row else wmo_allowed_m(true_m)
            s["within"] += is_value and abs(estimate - true_m) <= allowed
            if is_value:
                s["worst"] = max(s["worst"], abs(math.log(estimate / true_m)))
        elif true_m > high:
            s["beyond"] += 1
            s["beyond_right"] += limit_right or (is_value and abs(estimate - true_m) <= 0.3 * true_m)
        else:
            s["thick"] += 1
            s["thick_guessed"] += is_value and abs(estimate - true_m) > wmo_allowed_m(true_m)
        if is_value:
            error = abs(math.log(estimate / true_m))
            s["errors"].append(error)
            if truth.get("crb_ln_extinction"):
                s["bounds"].append(float(truth["crb_ln_extinction"]))
                s["ratios"].append(error / float(truth["crb_ln_extinction"]))
            if record["mor_low_m"] is not None and record["mor_high_m"] is not None:
                s["bounded"] += 1
                s["covered"] += record["mor_low_m"] <= true_m <= record["mor_high_m"]
        decided = is_value or (limit == "above" and is_limit and estimate >= 1000) or (
            limit == "below" and is_limit and estimate <= 1000)
        if decided and not 900 <= true_m <= 1100:
            s["fog_decided"] += 1
            said_fog = estimate < 1000 if is_value else limit == "below"
            s["fog_wrong"] += said_fog != (true_m < 1000)
        if truth.get("weather"):
            s["weather"] += 1
            s["weather_right"] += record["weather"] == truth["weather"]
    return s


def share(part, whole):
    return part / whole if whole else None


def summarise(s):
    median = lambda values: statistics.median(values) if values else None
    return {
        "frames": s["frames"], "values": s["values"], "limits": s["limits"],
        "wmo_share": share(s["within"], s["in_range"]), "worst_factor": math.exp(s["worst"]),
        "beyond_share": share(s["beyond_right"], s["beyond"]), "limits_right": share(s["limits_right"], s["limits"]),
        "coverage": share(s["covered"], s["bounded"]), "median_abs_ln": median(s["errors"]),
        "median_bound": median(s["bounds"]), "error_over_bound": median(s["ratios"]), "fog_wrong": s["fog_wrong"],
        "fog_decided": s["fog_decided"], "weather_share": share(s["weather_right"], s["weather"]),
        "thick": s["thick"], "thick_guessed": s["thick_guessed"],
    }


COLUMNS = [("frames", "frames", "{:d}"), ("values", "values", "{:d}"), ("wmo_share", "within", "{:.0%}"),
           ("worst_factor", "worst x", "{:.2f}"), ("beyond_share", "beyond", "{:.0%}"), ("limits_right", "limits", "{:.0%}"),
           ("coverage", "cover", "{:.0%}"), ("median_abs_ln", "|ln|", "{:.3f}"), ("median_bound", "CRB", "{:.3f}"),
           ("error_over_bound", "err/CRB", "{:.1f}"), ("fog_wrong", "fog wrong", "{:d}"),
           ("weather_share", "weather", "{:.0%}")]


def format_row(name, summary):
    cells = [f"{name:24}"]
    for key, title, form in COLUMNS:
        value = summary[key]
        cells.append(("-" if value is None else form.format(value)).rjust(max(7, len(title))))
    return " ".join(cells)


def print_header():
    print(" ".join([" " * 24] + [title.rjust(max(7, len(title))) for _, title, _ in COLUMNS]), flush=True)


def failures(name, summary):
    """What a row is below its floor in."""
    found = []
    for key, floor in FLOORS.get(name, {}).items():
        value = summary[key]
        bad = value is None or (value > floor if key in ("fog_wrong", "worst_factor", "median_abs_ln") else value < floor)
        if bad:
            found.append(f"{name}: {key} is {value}, floor {floor}")
    return found


def run_row(row, number, options, folder):
    pairs = []
    for k in range(options.seeds):
        source = next((i for i, r in enumerate(ROWS) if r["name"] == row.get("same_nights_as")), number)
        seed = options.first_seed + 100 * source + k
        archive = os.path.join(folder, f"{source:02}_{seed}")
        if not os.path.exists(archive):
            frames = max(options.frames, row.get("frames", 0))
            run([options.binary, "simulate", archive, "--seed", str(seed), "--frames", str(frames), "--photons",
                 str(options.photons)] + row["simulate"])
        output = json.loads(run([options.binary, "replay", archive, "--json", "--truth", f"{archive}/truth.csv"] +
                                row.get("replay", [])))
        with open(f"{archive}/truth.csv", newline="") as file:
            truth = {line["time_utc"]: line for line in csv.DictReader(file)}
        records = {r["time_utc"]: r for r in output["records"] if r["role"] == "observation"}
        if set(records) != set(truth):
            raise RuntimeError(f"{archive}: {len(records)} records for {len(truth)} frames of truth")
        pairs += [(records[t], truth[t]) for t in sorted(truth)]
    return summarise(score_pairs(pairs, row))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", required=True, help="the lampglow program")
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--seeds", type=int, default=1, help="nights of each row")
    parser.add_argument("--first-seed", type=int, default=1001)
    parser.add_argument("--photons", type=int, default=200000)
    parser.add_argument("--row", action="append", help="only rows of this name")
    parser.add_argument("--keep", help="make the archives here, and leave them (those that are there are used again)")
    parser.add_argument("--output", help="write all numbers to this JSON file")
    options = parser.parse_args()
    folder = options.keep or tempfile.mkdtemp(prefix="lampglow-bench-")
    os.makedirs(folder, exist_ok=True)
    print(f"{options.seeds} night(s) of {options.frames} frames a row, seeds from {options.first_seed}, "
          f"{options.photons} photons for each q\n")
    print_header()
    results, failed = {}, []
    try:
        for number, row in enumerate(ROWS):
            if options.row and row["name"] not in options.row:
                continue
            needed = [("simulate", o) for o in row["simulate"] if o.startswith("--luminaire")]
            needed += [("replay", o) for o in row.get("replay", []) if o.startswith("--")]
            missing = [f"{command} {option}" for command, option in needed if not supports(options.binary, command, option)]
            if missing:
                print(f"{row['name']:24} not run: this program has no {', '.join(missing)}", flush=True)
                continue
            started = time.monotonic()
            summary = run_row(row, number, options, folder)
            results[row["name"]] = summary | {"seconds": time.monotonic() - started}
            goal = f"   goal {row['goal']:.0%}" if "goal" in row else ""
            print(format_row(row["name"], summary) + goal, flush=True)
            failed += failures(row["name"], summary)
    finally:
        if not options.keep:
            shutil.rmtree(folder, ignore_errors=True)
    if options.output:
        with open(options.output, "w") as file:
            json.dump(results, file, indent=1)
    print("\nwithin: share within the WMO limits (one known lamp: within 20 %) up to 8 km (webcam 5 km), all frames counted;"
          "\nworst x: largest factor off in that range; beyond: farther, within 30 % or a true limit; limits: true ones;"
          "\ncover: truth within the 95 % bounds; |ln|: median error of ln(MOR); CRB: median Cramér-Rao bound of ln σ;"
          "\nerr/CRB: median of their ratio (0.67 is perfect); fog wrong: outside 900-1100 m; weather: class right.")
    for line in failed:
        print("BELOW ITS FLOOR:", line)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
