// The last 24 hours and a lamp's ring profile, drawn by dygraphs.
import { axisUnit, lengthText, settings, time } from "./format.js";

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function triangle(up) {
  return (graph, series, context, x, y, colour) => {
    const s = up ? -1 : 1;
    context.beginPath();
    context.moveTo(x - 4, y);
    context.lineTo(x + 4, y);
    context.lineTo(x, y + 8 * s);
    context.closePath();
    context.fillStyle = colour;
    context.fill();
  };
}

const none = [null, null, null];

// dygraphs' legend, which is not shown, asks for an inline style, which the page's security policy refuses: out with it.
if (typeof Dygraph !== "undefined") Dygraph.PLUGINS = Dygraph.PLUGINS.filter((plugin) => plugin !== Dygraph.Plugins.Legend);

// One row for each observation; a value, or a limit as a limit: no band, no line to it.
function toRow(row) {
  const u = axisUnit();
  const at = new Date(row.time_utc);
  if (row.mor_m === null) return [at, none, none, none];
  const v = row.mor_m / u;
  const point = [v, v, v];
  if (row.limit === "above") return [at, none, point, none];
  if (row.limit === "below") return [at, none, none, point];
  return [at, [(row.mor_low_m ?? row.mor_m) / u, v, Math.min(row.mor_high_m ?? row.mor_m, 1e6) / u], none, none];
}

// A hole in time is a hole in the line: where frames are missing, a row without a value stands between.
function withHoles(rows) {
  const steps = rows.slice(1).map((row, i) => row[0] - rows[i][0]).sort((a, b) => a - b);
  const longest = Math.max(5 * (steps[steps.length >> 1] || 0), 180e3);
  return rows.flatMap((row, i) =>
    i && row[0] - rows[i - 1][0] > longest ? [[new Date((row[0].getTime() + rows[i - 1][0].getTime()) / 2), none, none, none], row] : [row]);
}

const FOG_M = 1000, MIST_M = 5000, DAY_MS = 86400e3;

// Fog's and mist's limits are always in sight, so that a look at the height tells what the air is like.
function valueRange(data) {
  const values = data.flatMap((row) => row.slice(1).flat()).filter((v) => v !== null && v > 0);
  return [Math.min(500 / axisUnit(), ...values) / 1.15, Math.max(7000 / axisUnit(), ...values) * 1.15];
}

// As long as there are data for, 6 to 24 h.
function spanMs(data, last) {
  return Math.min(Math.max((last - data[0][0]) * 1.02, DAY_MS / 4), DAY_MS);
}

function drawLimits(canvas, area, graph) {
  const fog = graph.toDomYCoord(FOG_M / axisUnit()), mist = graph.toDomYCoord(MIST_M / axisUnit());
  canvas.fillStyle = css("--fog");
  canvas.fillRect(area.x, fog, area.w, area.y + area.h - fog);
  canvas.strokeStyle = canvas.fillStyle = css("--soft");
  canvas.setLineDash([5, 5]);
  canvas.beginPath();
  canvas.moveTo(area.x, mist);
  canvas.lineTo(area.x + area.w, mist);
  canvas.stroke();
  canvas.setLineDash([]);
  canvas.font = "12px system-ui, sans-serif";
  canvas.fillText("fog", area.x + 6, fog + 15);
  canvas.fillText("mist", area.x + 6, mist + 15);
}

export class Series {
  constructor(element, legend) {
    this.element = element;
    this.legend = legend;
    this.rows = new Map();
    this.graph = null;
    this.chosen = -1;
    element.addEventListener("keydown", (event) => this.onKey(event));
  }

  set(rows) {
    this.rows = new Map(rows.map((row) => [row.time_utc, row]));
    this.draw();
  }

  // Not drawn yet. What is older than the span that is shown goes.
  add(row) {
    this.rows.set(row.time_utc, row);
    const newest = Math.max(...[...this.rows.keys()].map((time) => Date.parse(time)));
    for (const key of this.rows.keys()) if (Date.parse(key) < newest - DAY_MS) this.rows.delete(key);
  }

  draw() {
    const all = [...this.rows.values()].sort((a, b) => (a.time_utc < b.time_utc ? -1 : 1));
    const last = all.length ? Date.parse(all[all.length - 1].time_utc) : 0;
    const data = withHoles(all.filter((row) => Date.parse(row.time_utc) > last - DAY_MS).map(toRow));
    this.chosen = -1;
    if (this.graph) this.graph.destroy();
    this.graph = null;
    if (!data.length || typeof Dygraph === "undefined") {
      this.element.textContent = "No observations in the last 24 hours.";
      return;
    }
    this.element.textContent = "";
    this.graph = new Dygraph(this.element, data, {
      labels: ["time", "value", "at least", "at most"], customBars: true, logscale: true,
      dateWindow: [last - spanMs(data, last), last + spanMs(data, last) / 100], valueRange: valueRange(data), underlayCallback: drawLimits,
      labelsUTC: settings.zone === "UTC", strokeWidth: 1.5, connectSeparatedPoints: false, fillAlpha: 0.22, gridLineColor: css("--line"),
      axisLineColor: css("--line"), colors: [css("--accent"), css("--above"), css("--below")], animatedZooms: false,
      series: {
        "at least": { strokeWidth: 0, drawPoints: true, pointSize: 4, drawPointCallback: triangle(true) },
        "at most": { strokeWidth: 0, drawPoints: true, pointSize: 4, drawPointCallback: triangle(false) },
      },
      axes: { y: { axisLabelWidth: 60, axisLabelFormatter: (v) => lengthText(v * axisUnit()) } },
      highlightCallback: (event, x) => this.describe(x),
      unhighlightCallback: () => this.describe(last),
    });
    this.describe(last);
  }

  // From frame to frame by the arrow keys, to the first and the last by Home and End.
  onKey(event) {
    if (!this.graph) return;
    const rows = this.graph.numRows(), now = this.chosen < 0 ? rows - 1 : this.chosen;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0;
    let next = { Home: 0, End: rows - 1 }[event.key] ?? now + step;
    if (next === now && !step) return;
    event.preventDefault();
    next = Math.min(Math.max(next, 0), rows - 1);
    if (!this.find(this.graph.getValue(next, 0))) next += step;  // over a hole
    this.chosen = next;
    this.graph.setSelection(next);
    this.describe(this.graph.getValue(next, 0));
  }

  find(x) {
    return this.rows.get([...this.rows.keys()].find((key) => Date.parse(key) === x));
  }

  describe(x) {
    const row = this.find(x);
    if (!row) return;
    const words = { above: "at least ", below: "at most " }[row.limit] || "";
    const band = row.limit || row.mor_low_m === null ? "" : ` (${lengthText(row.mor_low_m)} to ${lengthText(row.mor_high_m)})`;
    this.legend.textContent = `${time(row.time_utc)}: ${row.mor_m === null ? row.reason || "no value" : words + lengthText(row.mor_m) + band}, ${row.weather}`;
  }
}

export function drawProfile(element, profile) {
  element.textContent = "";
  const bars = (value, sigma) => [Math.max(value - sigma, 1e-12), Math.max(value, 1e-12), value + sigma];
  const rows = profile.thetaDegrees.map((theta, i) => {
    const row = [theta, bars(profile.radiance[i], profile.radianceSigma[i])];
    if (profile.model) row.push(bars(profile.model[i], 0));
    return row;
  });
  if (!rows.length || typeof Dygraph === "undefined") return null;
  return new Dygraph(element, rows, {
    labels: profile.model ? ["angle", "measured", "fit"] : ["angle", "measured"], customBars: true, logscale: true,
    gridLineColor: css("--line"), axisLineColor: css("--line"), colors: [css("--accent"), css("--below")],
    series: { measured: { drawPoints: true, pointSize: 3, strokeWidth: 0 }, fit: { strokeWidth: 2 } },
    axes: { x: { logscale: true, valueFormatter: (v) => `${v.toPrecision(2)}°`, axisLabelFormatter: (v) => `${Number(v.toPrecision(2))}°` },
            y: { axisLabelWidth: 60, axisLabelFormatter: (v) => Number(v.toPrecision(2)).toString() } },
  });
}
