#!/usr/bin/env python3
"""The power fails at random moments: power_cut_test.py LAMPGLOW DEB [CUTS [ROWS [SEED]]]

The machine is killed while it measures, each time 20 to 50 s after it was seen to measure again; the moments come from
the seed, which is printed. A row for each cut is written to the file ROWS, too; if that has rows already, only the rest of
the cuts is made: a run of hours that was ended goes on. After each cut it must come up by itself, pass SQLite's integrity check, hold everything that was
shown more than the bound before the cut (checkpoint_minutes = 0.25) with the same values, and nothing twice.
Exit 77: something can't be had here.

What is cut is the machine: qemu is killed, so what the guest's kernel and file system had not written is gone. What it
had written to its disk is kept, as by a disk whose cache survives.
"""
import pathlib
import random
import sys
import tempfile
import time

from machine import Follower, install, integrity, log, milliseconds, prepare, stored_rows, until

BOUND_S = 15.0
SLACK_S = 2.0  # the writer looks for what is due every 0.5 s; the emulated machine is slow


def cut_once(machine, draw, known):
    """One cut; returns (seconds it ran, shown, lost within the bound, seconds until it was ready again)."""
    follower = Follower(machine)
    until("observations", 180, lambda: follower.count() >= 1)
    seconds = draw.uniform(20, 50)
    time.sleep(seconds)
    follower.close()
    cut = time.monotonic()
    machine.cut_power()
    known.update({milliseconds(stamp): (seen, shown) for stamp, (seen, shown) in follower.seen.items()})
    machine.boot()
    until("station that comes up by itself", 180, lambda: machine.ask("/readyz")[0] == 200)
    up_s = time.monotonic() - cut
    assert integrity(machine) == "ok"
    rows, twice = stored_rows(machine)
    assert twice == 0, f"{twice} rows are there twice"
    lost = [key for key in known if key not in rows]
    too_old = [cut - known[key][0] for key in lost if known[key][0] < cut - BOUND_S - SLACK_S]
    assert not too_old, f"lost, though shown so many s before the cut: {too_old}"
    for key in lost:
        del known[key]
    check_values(known, rows)
    assert not machine.run("ls /var/lib/lampglow | grep corrupt || true"), "a database was set aside"
    return seconds, len(follower.seen), len(lost), up_s


def check_values(known, rows):
    for key, (_, shown) in known.items():
        stored, value = rows[key], shown["extinction"]["value"] if "extinction" in shown else None
        if value is not None:
            assert abs(float(stored) - value) <= 1e-6 * abs(value), f"{key}: shown {value}, stored {stored}"


def rows_in(file):
    return [line for line in file.read_text().splitlines() if line.startswith("|")] if file and file.exists() else []


def put_row(file, row):
    print(row, flush=True)
    if file:
        with file.open("a") as out:
            out.write(row + "\n")


def main():
    lampglow, deb, cuts, rows, seed, *_ = [*sys.argv[1:], *[""] * 3]
    cuts, rows = int(cuts or 3), pathlib.Path(rows) if rows else None
    seed, done = int(seed or random.SystemRandom().randrange(1 << 30)), len(rows_in(rows))
    draw, known = random.Random(seed), {}
    log(f"{cuts} power cuts, {done} of them made before, seed {seed}, bound {BOUND_S:.0f} s")
    with tempfile.TemporaryDirectory(prefix="lampglow-vm-") as folder:
        machine, camera = prepare(pathlib.Path(folder), lampglow, deb)
        try:
            machine.boot()
            install(machine, camera, checkpoint_minutes=BOUND_S / 60)
            machine.run("sync")  # the package's own files: dpkg syncs them but for the last
            print("| seed | cut | ran, s | shown | lost within the bound | ready again after, s |\n|---|---|---|---|---|---|")
            for number in range(done + 1, cuts + 1):
                ran_s, shown, lost, up_s = cut_once(machine, draw, known)
                put_row(rows, f"| {seed} | {number} | {ran_s:.1f} | {shown} | {lost} | {up_s:.0f} |")
            log(f"{len(known)} observations are in the database, none lost beyond the bound, none twice, integrity_check ok")
        except BaseException:
            print(machine.console()[-6000:])
            raise
        finally:
            machine.close()
            camera.close()


if __name__ == "__main__":
    main()
