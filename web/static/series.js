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

export class Series {
  constructor(element, legend) {
    this.element = element;
    this.legend = legend;
    this.rows = new Map();
    this.graph = null;
  }

  set(rows) {
    this.rows = new Map(rows.map((row) => [row.time_utc, row]));
    this.draw();
  }

  add(row) {
    this.rows.set(row.time_utc, row);
    this.draw();
  }

  draw() {
    const all = [...this.rows.values()].sort((a, b) => (a.time_utc < b.time_utc ? -1 : 1));
    const last = all.length ? Date.parse(all[all.length - 1].time_utc) : 0;
    const data = all.filter((row) => Date.parse(row.time_utc) > last - 86400e3).map(toRow);
    if (this.graph) this.graph.destroy();
    this.graph = null;
    if (!data.length || typeof Dygraph === "undefined") {
      this.element.textContent = "No observations in the last 24 hours.";
      return;
    }
    this.element.textContent = "";
    this.graph = new Dygraph(this.element, data, {
      labels: ["time", "value", "at least", "at most"], customBars: true, logscale: true,
      labelsUTC: settings.zone === "UTC", strokeWidth: 1.5, connectSeparatedPoints: false, fillAlpha: 0.22, gridLineColor: css("--line"),
      axisLineColor: css("--line"), colors: [css("--accent"), css("--above"), css("--below")], animatedZooms: false,
      series: {
        "at least": { strokeWidth: 0, drawPoints: true, pointSize: 4, drawPointCallback: triangle(true) },
        "at most": { strokeWidth: 0, drawPoints: true, pointSize: 4, drawPointCallback: triangle(false) },
      },
      axes: { y: { axisLabelWidth: 60, axisLabelFormatter: (v) => lengthText(v * axisUnit()) } },
      highlightCallback: (event, x) => this.describe(x),
      unhighlightCallback: () => { this.legend.textContent = ""; },
    });
  }

  describe(x) {
    const row = this.rows.get([...this.rows.keys()].find((key) => Date.parse(key) === x));
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
    series: { measured: { drawPoints: true, pointSize: 3, strokeWidth: 0 } },
    axes: { x: { logscale: true, valueFormatter: (v) => `${v.toPrecision(2)}°`, axisLabelFormatter: (v) => `${Number(v.toPrecision(2))}°` },
            y: { axisLabelWidth: 60, axisLabelFormatter: (v) => Number(v.toPrecision(2)).toString() } },
  });
}
